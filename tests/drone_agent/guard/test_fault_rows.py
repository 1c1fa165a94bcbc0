"""Every row of the signature table, and frozen poses, by the bridge."""

from collections.abc import Callable

import numpy as np
import pytest

from drone_agent.guard.integrity import SIGNATURES
from drone_agent.guard.stages import Stage
from drone_agent.guarded import DroneOutgoing
from formation.maths.arrays import Quat, Vec3
from formation.maths.frames import from_rotation_vector, multiply
from tests.drone_agent.agent_harness import Harness, S, Stream, hover_at, hover_over
from wire.link_messages import AttitudeSetpoint, InertialSample, MavCommand, MessageId, Result

Shown = tuple[Vec3, Quat]
Spoil = Callable[[list[Shown], float], Shown]
"""The pose shown instead, of the true ones until now and the time, s, since the fault began."""


def flying(height_m: float = 1.0, **config: object) -> Harness:
    drone = Harness(pose="mocap", profile="px4_quad", **config)
    drone.fly_offboard(height_m, hover_over(0.0, 0.0, height_m))
    return drone


def swinging(drone: Harness) -> AttitudeSetpoint:
    """A ground that flies it round a circle with 0.5 m/s, so that a delay shows; it sees the truth."""
    t_s = drone.now_ns / S
    return hover_over(np.sin(1.5 * t_s), np.cos(1.5 * t_s), 1.0)(drone)


def fly_spoilt(drone: Harness, seconds: float, stream: Stream, spoil: Spoil) -> float | None:
    """Fly on with spoilt poses; after how many seconds they were rejected."""
    seen: list[Shown] = []
    found_s, start_ns = None, drone.now_ns + S // 4
    while drone.now_ns < start_ns + seconds * S:
        drone.run(0.01, stream, mocap=False)
        seen.append((drone.truth.pos_lab_m, drone.truth.q_lab_from_flu))
        t_s = (drone.now_ns - start_ns) / S
        drone.show(*(spoil(seen, t_s) if t_s > 0.0 else seen[-1]))
        if found_s is None and drone.core.guards[0]._feed.fault:
            found_s = t_s
    return found_s


def drift(speed_m_s: float) -> Spoil:
    return lambda seen, t_s: (seen[-1][0] + np.array([speed_m_s * t_s, 0.0, 0.0]), seen[-1][1])


def jump(seen: list[Shown], t_s: float) -> Shown:
    return seen[-1][0] + np.array([0.3, 0.0, 0.0]), seen[-1][1]


def turned(seen: list[Shown], t_s: float) -> Shown:
    return seen[-1][0], multiply(from_rotation_vector(np.array([0.1, 0.0, 0.0])), seen[-1][1])


def late(frames: int) -> Spoil:
    return lambda seen, t_s: seen[-1 - frames]


def later(seen: list[Shown], t_s: float) -> Shown:
    """By up to 0.2 s, growing within two seconds."""
    return seen[-1 - min(round(10.0 * t_s), 20)]


def frozen(seen: list[Shown], t_s: float) -> Shown:
    return seen[-1 - round(100.0 * t_s)]


ROWS = {
    "pose jump": (jump, 0.05),
    "pose drift": (drift(0.08), 0.2),
    "pose delay": (late(12), 0.1),
    "pose delay growing": (later, 4.2),
    "pose attitude inconsistent": (turned, 0.05),
    "pose frozen": (frozen, 0.2),
}


SHOWN_BY_THRUST = ("pose jump", "pose delay", "pose attitude inconsistent", "pose frozen")
"""What attitude and commanded thrust show, where the autopilot sends no HIGHRES_IMU: all that is sudden."""


NIGHTLY = [pytest.param(name, 0.0, marks=pytest.mark.nightly) for name in SHOWN_BY_THRUST[1:]]


@pytest.mark.parametrize(
    ("name", "inertial_rate_hz"), [*((name, 100.0) for name in ROWS), (SHOWN_BY_THRUST[0], 0.0), *NIGHTLY]
)
def test_a_faulty_pose_is_held_against_and_the_drone_comes_down(name: str, inertial_rate_hz: float) -> None:
    """Held within the row's time of its onset, then let down near its place: a pose fault is none of the drone's."""
    fault, within_s = ROWS[name]
    drone = flying(inertial_rate_hz=inertial_rate_hz)
    drone.run(5.0, swinging)
    place = drone.truth.pos_lab_m
    found_s = fly_spoilt(drone, 8.0, swinging, fault)
    assert found_s is not None
    assert found_s <= within_s
    assert sum(text.startswith("Pose rejected, ") for text in drone.texts()) == 1
    assert "No pose to land on: coming down level" in drone.texts()
    assert drone.truth.on_ground
    assert np.linalg.norm((drone.truth.pos_lab_m - place)[:2]) < 1.2


def trembling(seen: list[Shown], t_s: float) -> Shown:
    """Frozen in front of cameras that have noise."""
    noise = 3e-4 * np.random.default_rng(len(seen)).standard_normal(6)
    pos, q = frozen(seen, t_s)
    return pos + noise[:3], multiply(from_rotation_vector(3.0 * noise[3:]), q)


@pytest.mark.parametrize("inertial_rate_hz", [100.0, 0.0])
@pytest.mark.parametrize("fault", [frozen, trembling])
def test_a_pose_that_freezes_in_motion_takes_the_drone_no_further_than_it_brakes_in(
    fault: Spoil, inertial_rate_hz: float
) -> None:
    """At 0.5 m/s. The ground commands a landing meanwhile, of an autopilot that was shown a body at rest until it was
    detected: PX4 landed 0.9 m away. The guard, whose estimate goes back to before the fault, lands it instead."""
    drone = flying(inertial_rate_hz=inertial_rate_hz)
    drone.run(5.0, swinging)
    place = drone.truth.pos_lab_m
    assert 0.4 < np.linalg.norm(drone.truth.vel_lab_m_s) < 0.8
    found_s = fly_spoilt(drone, 0.2, swinging, fault)
    assert found_s is not None
    assert drone.command(MavCommand.NAV_LAND) is Result.ACCEPTED
    assert drone.texts()[-1] == "Landing commanded, pose rejected: the guard lands it"
    assert drone.stream.stage is Stage.LAND
    farthest_m, handed_over = 0.0, False
    for _ in range(80):
        drone.run(0.1, mocap=False)
        handed_over |= not drone.truth.on_ground and "Landing at current position" in drone.texts()
        farthest_m = max(farthest_m, float(np.linalg.norm((drone.truth.pos_lab_m - place)[:2])))
    assert drone.truth.on_ground
    assert not drone.autopilot.armed
    assert handed_over is (inertial_rate_hz == 0.0)
    assert farthest_m < 0.4


def test_poses_that_seem_right_again_are_not_shown_to_an_autopilot_that_lands_without() -> None:
    """PX4, let down from a pose that slid, was shown it again after 1.2 s: it landed by it, 1.4 m away."""
    drone, stream, shown = flying(), hover_over(0.0, 0.0, 1.0), []
    tick = drone.core.tick

    def seen(now_ns: int) -> DroneOutgoing:
        out = tick(now_ns)
        shown.extend(frame.number for frame in out.to_autopilot if frame.number == MessageId.VISION_POSITION_ESTIMATE)
        return out

    drone.core.tick = seen  # type: ignore[method-assign]
    drone.run(5.0, stream)
    assert fly_spoilt(drone, 0.6, stream, jump) is not None
    assert "No pose to land on: coming down level" in drone.texts()
    shown.clear()
    rejects = []
    while drone.autopilot.armed:
        drone.run(0.1, stream)
        rejects.append(bool(drone.core.guards[0]._feed.fault))
    assert (rejects[0], rejects[-1]) == (True, False)
    assert not shown
    drone.run(1.0, stream)
    assert shown


def test_who_is_led_away_by_a_pose_that_drifts_comes_down_where_it_was() -> None:
    """By a ground that holds it where the drifting pose says."""
    drone = flying()
    place, t0_ns = drone.truth.pos_lab_m, drone.now_ns + S // 4
    fly_spoilt(drone, 5.0, lambda d: hover_over(-0.35 * max(d.now_ns - t0_ns, 0) / S, 0.0, 1.0)(d), drift(0.35))
    assert drone.truth.on_ground
    assert np.linalg.norm((drone.truth.pos_lab_m - place)[:2]) < 0.3


def test_on_the_floor_no_pose_drifts() -> None:
    """Motors that start shake what it measures: a real take-off was broken off on the floor."""
    drone = Harness(pose="mocap", profile="px4_quad")
    drone.run(6.0)
    drone.run(0.2, hover_at(-1.0))
    assert drone.command(176, 1.0, 6.0) == drone.command(400, 1.0) == 0
    assert fly_spoilt(drone, 2.0, hover_at(-1.0), drift(0.5)) is None


def test_every_row_has_a_test_here() -> None:
    """And in test_landing, of each vehicle: the loss of vertical thrust."""
    assert {row.name for row in SIGNATURES} == {*ROWS, "vertical thrust loss"} - {"pose frozen"}


@pytest.mark.parametrize("inertial_rate_hz", [100.0, 0.0])
def test_a_flight_without_a_fault_is_left_alone(inertial_rate_hz: float) -> None:
    drone = flying(inertial_rate_hz=inertial_rate_hz)
    drone.run(20.0, swinging)
    assert not any("rejected" in text or "missing" in text for text in drone.texts())
    assert not any(isinstance(message, InertialSample) for _, message in drone.heard)
