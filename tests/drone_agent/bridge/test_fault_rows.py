"""Every row of the signature table, and frozen poses, by the bridge."""

from collections.abc import Callable

import numpy as np
import pytest

from drone_agent.guard.integrity import SIGNATURES
from drone_agent.stages import Stage
from formation.maths.arrays import Quat, Vec3
from formation.maths.frames import from_rotation_vector, multiply
from tests.drone_agent.agent_harness import Harness, S, hover_over
from tests.drone_agent.bridge.test_bridge import Site
from wire.link_messages.setpoints import AttitudeSetpoint

Shown = tuple[Vec3, Quat]


def swinging(site: Site) -> Callable[[Harness], AttitudeSetpoint]:
    """A ground that flies it round a circle with 0.5 m/s, so that a delay shows; it sees the truth."""

    def stream(drone: Harness) -> AttitudeSetpoint:
        t_s = site.now_ns / S
        setpoint = hover_over(np.sin(1.5 * t_s), np.cos(1.5 * t_s), 1.0)(drone)
        assert setpoint is not None
        return setpoint

    return stream


def drift(speed_m_s: float) -> Callable[[list[Shown], float], Shown]:
    return lambda seen, t_s: (seen[-1][0] + np.array([speed_m_s * t_s, 0.0, 0.0]), seen[-1][1])


def jump(seen: list[Shown], t_s: float) -> Shown:
    return seen[-1][0] + np.array([0.3, 0.0, 0.0]), seen[-1][1]


def turned(seen: list[Shown], t_s: float) -> Shown:
    return seen[-1][0], multiply(from_rotation_vector(np.array([0.1, 0.0, 0.0])), seen[-1][1])


def late(frames: int) -> Callable[[list[Shown], float], Shown]:
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


@pytest.mark.parametrize(
    ("name", "inertial_rate_hz"), [*((name, 100.0) for name in ROWS), *((name, 0.0) for name in SHOWN_BY_THRUST)]
)
def test_a_faulty_pose_is_held_against_and_the_drone_comes_down(name: str, inertial_rate_hz: float) -> None:
    """Held within the row's time of its onset, then let down near its place: a pose fault is none of the drone's."""
    fault, within_s = ROWS[name]
    site = Site(inertial_rate_hz=inertial_rate_hz)
    site.fly(1.0, swinging(site))
    place = site.drone.truth.pos_lab_m
    site.spoil = fault
    found_s, start_ns = None, site.now_ns
    while site.now_ns - start_ns < 8 * S:
        site.run(0.01, swinging(site))
        if found_s is None and site.bridge.rejects_poses:
            found_s = (site.now_ns - start_ns) / S
    assert found_s is not None
    assert found_s <= within_s
    rejected = [text for text in site.texts() if text.startswith("Pose rejected, ")]
    assert len(rejected) == 1
    assert "No pose to land on: coming down level" in site.texts()
    assert site.drone.truth.on_ground
    assert np.linalg.norm((site.drone.truth.pos_lab_m - place)[:2]) < 1.2


@pytest.mark.parametrize("loss", [0.3, 0.45])
def test_a_drone_whose_thrust_is_lost_is_landed_on_what_is_left(loss: float) -> None:
    site = Site()
    site.fly(1.0, hover_over(0.0, 0.0, 1.0))
    start_ns = site.now_ns
    site.drone.airframe.motor_gain = np.full(4, 1.0 - loss)
    while site.bridge._takeover.stream.stage is not Stage.LAND and site.now_ns - start_ns < S:
        site.run(0.01, hover_over(0.0, 0.0, 1.0))
    assert site.now_ns - start_ns <= 0.4 * S
    fastest_m_s = 0.0
    for _ in range(70):
        site.run(0.1, hover_over(0.0, 0.0, 1.0))
        fastest_m_s = min(fastest_m_s, float(site.drone.truth.vel_lab_m_s[2]))
    assert "Part of its thrust is missing: landing on what is left" in site.texts()
    assert site.drone.truth.on_ground
    assert fastest_m_s > -1.1
    assert not site.drone.autopilot.armed


def test_every_row_has_a_test_here() -> None:
    assert {row.name for row in SIGNATURES} == {*ROWS, "vertical thrust loss"} - {"pose frozen"}


@pytest.mark.parametrize("inertial_rate_hz", [100.0, 0.0])
def test_a_flight_without_a_fault_is_left_alone(inertial_rate_hz: float) -> None:
    site = Site(inertial_rate_hz=inertial_rate_hz)
    site.fly(1.0, swinging(site))
    site.run(20.0, swinging(site))
    assert not any("rejected" in text or "missing" in text for text in site.texts())
