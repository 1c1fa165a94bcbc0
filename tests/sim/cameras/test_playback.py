import numpy as np

from formation.maths import frames
from mocap.sources.csv_file import Recording
from sim.cameras.playback import EASE_IN_NS, Playback

S = 1_000_000_000


def circling(seconds: float = 10.0, seed: int = 3) -> Recording:
    """A body on a circle of 1 m at 1 rad/s, recorded with jittered stamps, heading along the tangent."""
    rng = np.random.default_rng(seed)
    t_ns = np.cumsum(rng.integers(8_000_000, 14_000_000, int(seconds * 90)))
    t_ns = t_ns - t_ns[0]
    angle = t_ns * 1e-9
    pos = np.column_stack([np.cos(angle), np.sin(angle), np.ones_like(angle)])
    return Recording(t_ns, pos, frames.from_yaw(angle + np.pi / 2))


def test_until_the_start_the_first_pose_is_held() -> None:
    playback = Playback(circling())
    pos, q = playback.pose(-5 * S)
    assert pos.tolist() == [1.0, 0.0, 1.0]
    assert np.isclose(frames.yaw(q), np.pi / 2)


def test_after_the_ease_in_every_exposure_is_a_recorded_one_in_order_and_complete() -> None:
    recording = circling()
    playback = Playback(recording)
    elapsed: int | None = EASE_IN_NS
    stamps, positions = [], []
    while (elapsed := playback.next_exposure_ns(elapsed)) is not None:
        stamps.append(elapsed - EASE_IN_NS // 2)
        positions.append(playback.pose(elapsed)[0])
    kept = recording.t_ns > EASE_IN_NS // 2
    assert stamps == recording.t_ns[kept].tolist()
    assert np.array_equal(np.array(positions), recording.pos_mocap_m[kept])


def test_a_recording_that_begins_in_motion_is_eased_into() -> None:
    playback = Playback(circling())
    t_ns = np.arange(-S // 2, 3 * S, 5_000_000)
    pos = np.array([playback.pose(int(t))[0] for t in t_ns])
    speed = np.linalg.norm(np.diff(pos, axis=0), axis=1) / 0.005
    assert speed[:100].max() == 0.0
    assert np.all(np.diff(speed) < 0.02)
    assert abs(speed[-1] - 1.0) < 0.01


def test_at_the_end_the_last_pose_is_held() -> None:
    recording = circling()
    playback = Playback(recording)
    assert playback.duration_ns == int(recording.t_ns[-1]) + EASE_IN_NS // 2
    assert np.array_equal(playback.pose(playback.duration_ns + S)[0], recording.pos_mocap_m[-1])


def test_between_two_records_the_pose_lies_between_even_across_the_quaternion_sign() -> None:
    yaws = np.array([np.pi - 0.1, np.pi + 0.1])
    q = frames.from_yaw(yaws)
    recording = Recording(np.array([0, 2 * S]), np.array([[0.0, 0, 0], [2.0, 0, 0]]), q)
    pos, q_between = Playback(recording).pose(S + EASE_IN_NS // 2)
    assert np.allclose(pos, [1.0, 0.0, 0.0])
    assert np.isclose(abs(frames.yaw(q_between)), np.pi)


def test_a_standing_body_keeps_the_cameras_own_rhythm() -> None:
    playback = Playback.standing(np.array([1.0, 2.0, 3.0]), frames.IDENTITY)
    assert not playback.recorded
    assert playback.next_exposure_ns(5 * S) is None
    assert playback.pose(7 * S)[0].tolist() == [1.0, 2.0, 3.0]


def test_a_recording_that_ends_with_a_landing_is_left_before_it() -> None:
    flight = circling(10.0)
    rest_ns = flight.t_ns[-1] + np.arange(1, 301) * 10_000_000
    landed = Recording(
        np.concatenate([flight.t_ns, rest_ns]),
        np.concatenate([flight.pos_mocap_m, np.repeat(flight.pos_mocap_m[-1:], 300, axis=0)]),
        np.concatenate([flight.q_mocap_from_marker, np.repeat(flight.q_mocap_from_marker[-1:], 300, axis=0)]),
    )
    assert Playback(flight).flight_ns == Playback(flight).duration_ns
    left_s = (Playback(landed).flight_ns - EASE_IN_NS // 2) * 1e-9
    assert 8.0 < left_s < 9.0, "about a second before the ten seconds of motion end"


def test_in_a_gap_the_cameras_keep_their_rhythm_and_do_not_see_the_body() -> None:
    whole = circling(5.0)
    kept = (whole.t_ns < 2 * S) | (whole.t_ns > 2 * S + 870_000_000)
    playback = Playback(Recording(whole.t_ns[kept], whole.pos_mocap_m[kept], whole.q_mocap_from_marker[kept]))
    last, first = whole.t_ns[whole.t_ns < 2 * S][-1], whole.t_ns[whole.t_ns > 2 * S + 870_000_000][0]
    before, after = (int(t_ns) + EASE_IN_NS // 2 for t_ns in (last, first))
    exposures = [before]
    while exposures[-1] < after:
        exposures.append(playback.next_exposure_ns(exposures[-1]) or after)
    assert exposures[-1] == after
    assert 6_000_000 <= np.diff(exposures).min() <= np.diff(exposures).max() <= 16_000_000
    assert [playback.is_in_sight(t) for t in (before, before + 10_000_000, after - 10_000_000, after)] == [
        True, False, False, True
    ]  # fmt: skip
    assert playback.is_in_sight(0)
    assert Playback.standing(np.zeros(3), frames.IDENTITY).is_in_sight(5 * S)
