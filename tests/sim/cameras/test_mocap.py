from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from formation.config import FollowerConfig, LabConfig, LeaderConfig
from formation.maths import frames
from formation.messages import RawFrame, Truth
from sim.cameras.emulator import EmulatorConfig, Gap, MocapEmulator
from wire.transport.memory_bus import NOTHING_DUE_NS

S = 1_000_000_000
QUIET = EmulatorConfig(jitter_s=0.0, noise_m=0.0, noise_rad=0.0, delay_jitter_s=0.0)


def a_lab(**changes: object) -> LabConfig:
    fields: dict[str, object] = {
        "leader": LeaderConfig(body="L", sysid=1),
        "followers": (FollowerConfig(body="F", sysid=2, offset_m=(-0.4, -0.4, 0.0)),),
    }
    return LabConfig.model_validate(fields | changes)


def a_truth(t_ns: int, sysid: int, pos: tuple[float, float, float], **changes: object) -> Truth:
    zero = np.zeros(3)
    fields = {
        "vel_lab_m_s": zero, "q_lab_from_flu": frames.IDENTITY, "rate_flu_rad_s": zero, "dist_lab_m_s2": zero,
        "on_ground": False,
    } | changes  # fmt: skip
    return Truth(t_ns=t_ns, sysid=sysid, pos_lab_m=np.array(pos), **fields)  # type: ignore[arg-type]


def film(emulator: MocapEmulator, seconds: float, truths: dict[int, Truth] | None = None) -> list[tuple[int, RawFrame]]:
    """Run the emulator on standing drones; frames with the time at which each arrived."""
    arrived, now, end = [], 0, round(seconds * S)
    while now <= end:
        now = min(emulator.next_exposure_ns, emulator.next_frame_ns)
        arrived += [(now, frame) for frame in emulator.pop_due(now)]
        if emulator.next_exposure_ns <= now:
            standing = {1: a_truth(now, 1, (0, 0, 0)), 2: a_truth(now, 2, (-0.4, -0.4, 0))}
            emulator.expose(standing if truths is None else truths)
    return arrived


def test_an_ideal_mocap_shows_every_body_where_it_is_at_its_rate_after_its_delay() -> None:
    arrived = film(MocapEmulator(QUIET, a_lab(), None, 1, 0), 1.0)
    assert abs(len(arrived) - 100) <= 1
    for seq, (now, frame) in enumerate(arrived):
        assert frame.seq == seq
        assert frame.t_capture_ns == seq * 10_000_000
        assert now - frame.t_capture_ns == 8_000_000
        assert frame.bodies == ("L", "F")
        assert frame.seen.all()
        assert np.allclose(frame.pos_mocap_m, [[0, 0, 0], [-0.4, -0.4, 0]], atol=1e-15)


def test_noise_and_jitter_have_the_size_asked_for_and_the_seed_decides_them() -> None:
    config = EmulatorConfig(jitter_s=0.001, noise_m=0.0002, noise_rad=0.002)
    arrived = film(MocapEmulator(config, a_lab(), None, 5, 0), 20.0)
    pos = np.array([frame.pos_mocap_m[0] for _, frame in arrived])
    q = np.array([frame.q_mocap_from_marker[0] for _, frame in arrived])
    spacing = np.diff([frame.t_capture_ns for _, frame in arrived])
    assert np.allclose(pos.std(axis=0), 0.0002, rtol=0.1)
    assert np.allclose((2 * q[:, 1:]).std(axis=0), 0.002, rtol=0.1)
    assert np.isclose(spacing.std(), 0.001 * np.sqrt(2) * 1e9, rtol=0.1)
    assert spacing.min() > 0
    again = film(MocapEmulator(config, a_lab(), None, 5, 0), 1.0)
    other = film(MocapEmulator(config, a_lab(), None, 6, 0), 1.0)
    assert all(np.array_equal(a.pos_mocap_m, b.pos_mocap_m) for (_, a), (_, b) in zip(arrived, again, strict=False))
    assert not np.array_equal(arrived[0][1].pos_mocap_m, other[0][1].pos_mocap_m)


def test_a_truth_a_little_old_is_moved_on_to_the_exposure() -> None:
    emulator = MocapEmulator(QUIET, a_lab(), None, 1, 4_000_000)
    moving = a_truth(0, 1, (1.0, 0.0, 0.5), vel_lab_m_s=np.array([0.5, 0, 0]), rate_flu_rad_s=np.array([0, 0, 2.0]))
    emulator.expose({1: moving, 2: a_truth(0, 2, (0, 0, 0))})
    frame = emulator.pop_due(NOTHING_DUE_NS)[0]
    assert np.allclose(frame.pos_mocap_m[0], [1.002, 0.0, 0.5])
    assert np.isclose(frames.yaw(frame.q_mocap_from_marker[0]), 0.008, atol=1e-6)


def test_no_pose_is_made_up_of_a_body_whose_process_is_late() -> None:
    """In 50 ms a body that brakes with 5 m/s^2 is 6 mm from where it would have gone on to."""
    emulator = MocapEmulator(QUIET, a_lab(), None, 1, 50_000_000)
    moving = a_truth(0, 1, (1.0, 0.0, 0.5), vel_lab_m_s=np.array([0.5, 0, 0]))
    emulator.expose({1: moving, 2: a_truth(45_000_000, 2, (0, 0, 0))})
    assert emulator.pop_due(NOTHING_DUE_NS)[0].seen.tolist() == [False, True]


def test_gaps_count_from_the_formation_and_hide_one_body_or_all() -> None:
    gaps = (Gap(at_s=0.2, for_s=0.05), Gap(at_s=0.5, for_s=0.1, body="F"))
    emulator = MocapEmulator(QUIET.model_copy(update={"gaps": gaps}), a_lab(), None, 1, 0)
    before = film(emulator, 1.0)
    emulator.start(2 * S)
    after = film(emulator, 3.0)
    assert all(frame.seen.all() for _, frame in before)
    stamps = np.array([frame.t_capture_ns for _, frame in after]) - 2 * S
    assert not np.any((stamps >= 200_000_000) & (stamps < 250_000_000))
    hidden = stamps[[not frame.seen[1] for _, frame in after]]
    assert (hidden.min(), hidden.max()) == (500_000_000, 590_000_000)
    assert all(frame.seen[0] for _, frame in after)


@settings(max_examples=30)
@given(st.floats(10, 240), st.floats(0, 0.02), st.floats(0, 0.05), st.integers(0, 2**32))
def test_stamps_rise_and_frames_never_overtake_each_other(rate: float, jitter: float, late: float, seed: int) -> None:
    config = EmulatorConfig(rate_hz=rate, jitter_s=jitter, delay_jitter_s=late)
    arrived = film(MocapEmulator(config, a_lab(), None, seed, 0), 1.0)
    stamps = [frame.t_capture_ns for _, frame in arrived]
    assert all(a < b for a, b in pairwise(stamps))
    assert all(now >= frame.t_capture_ns + 8_000_000 for now, frame in arrived)
    assert [frame.seq for _, frame in arrived] == sorted(frame.seq for _, frame in arrived)


def test_frames_that_are_overtaken_come_just_behind_the_next_and_none_is_lost() -> None:
    arrived = film(MocapEmulator(QUIET.model_copy(update={"reordered_share": 0.1}), a_lab(), None, 1, 0), 20.0)
    numbers = np.array([frame.seq for _, frame in arrived])
    assert set(numbers) == set(range(len(numbers)))
    back = np.diff(numbers)[np.diff(numbers) < 0]
    assert set(back) == {-1}
    assert 0.05 < len(back) / len(numbers) < 0.15


def test_a_stalled_network_sends_what_it_held_at_once_and_stamps_it_then() -> None:
    """No frame is lost; those held come within 2 ms after up to 0.3 s, stamped in their order as they arrive."""
    config = QUIET.model_copy(update={"stall_s": 0.3, "stall_every_s": 0.5, "arrival_stamps": True})
    arrived = film(MocapEmulator(config, a_lab(), None, 1, 0), 20.0)
    assert [frame.seq for _, frame in arrived] == list(range(len(arrived)))
    stamps = np.array([frame.t_capture_ns for _, frame in arrived])
    assert np.abs(stamps - np.array([now for now, _ in arrived])).max() < 100_000
    spacing_ns = np.diff(stamps)
    assert spacing_ns.min() > 0
    assert (spacing_ns < 2_000_000).mean() > 0.1
    assert 0.15 * S < spacing_ns.max() < 0.32 * S
