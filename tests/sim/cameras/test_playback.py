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
