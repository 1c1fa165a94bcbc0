"""Landings that end, and end on the floor: the ground dead, no pose, a wrong one, a dead motor, a stop."""

import numpy as np
import pytest

from drone_agent.flight import ekf
from drone_agent.flight.landing import ContactDetector
from drone_agent.guard.stages import TABLE, Stage, Trigger
from formation.maths.frames import from_rotation_vector
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import profile as profile_of
from tests.drone_agent.agent_harness import MS, Harness, S, hover_at, hover_over, idle, target
from wire.link_messages import AttitudeSetpoint, Result

PAPER = profile_of("paper_40g")
ARM, LAND, MODE = 400, 21, 176
CUT = 21196.0
OWN_DELAY_S = {"px4": 2.0, "ardupilot": 0.5}
"""From touch-down to disarming: PX4's COM_DISARM_LAND, ArduCopter's LAND."""


def down(harness: Harness, longest_s: float, *, mocap: bool = True) -> tuple[float, float]:
    """Seconds until it is disarmed, and the fastest it met the floor, m/s."""
    began_ns, sinking, impact = harness.now_ns, 0.0, 0.0
    while harness.autopilot.armed and harness.now_ns < began_ns + longest_s * S:
        harness.run(0.01, mocap=mocap)
        truth = harness.truth
        if truth.on_ground:
            impact, sinking = max(impact, sinking), 0.0
        else:
            sinking = -float(truth.vel_lab_m_s[2])
    return (harness.now_ns - began_ns) / S, impact


OTHERWISE = {"px4": {"COM_OBL_RC_ACT": 5.0, "COM_OF_LOSS_T": 0.3}, "ardupilot": {"GUID_TIMEOUT": 0.2}}
"""PX4 told to hold at a lost stream, ArduPilot to level for ever: neither ever misses the guard's targets."""


@pytest.mark.parametrize(("flown_s", "parameters"), [(0.05, {}), (1.0, {}), (4.0, {}), (4.0, OTHERWISE)])
@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_the_ground_dies_at_any_time_and_all_is_down_soon(autopilot: str, flown_s: float, parameters: dict) -> None:
    """Within 5.5 s from 0.9 m, the last of them at 0.3 m/s. ArduPilot's own time-out left it hovering for ever."""
    harness = Harness(pose="mocap", autopilot=autopilot, parameters=parameters.get(autopilot, {}))
    harness.run(3.0)
    harness.run(1.2, idle)
    assert harness.command(MODE, 1.0, 6.0 if autopilot == "px4" else 4.0) is Result.ACCEPTED
    assert harness.command(ARM, 1.0) is Result.ACCEPTED
    harness.run(flown_s, hover_over(0.3, 0.0, 1.5))
    seconds, impact = down(harness, 12.0)
    assert not harness.autopilot.armed
    assert seconds - OWN_DELAY_S[autopilot] < 5.5
    assert impact <= 0.4


def test_an_operators_mode_ends_the_guards_own_landing() -> None:
    harness = Harness(pose="mocap")
    harness.fly_offboard(1.0)
    harness.run(0.5)
    assert harness.command(MODE, 1.0, 3.0) is Result.TEMPORARILY_REJECTED  # PX4's position mode wants a pilot
    assert harness.command(MODE, 1.0, 4.0, 2.0) is Result.ACCEPTED
    harness.run(0.05)
    assert harness.stream.stage is Stage.OWN
    harness.run(3.0)
    assert harness.autopilot.armed


@pytest.mark.parametrize("error_m_s", [-0.8, 0.8])
def test_a_landing_ends_though_its_estimate_says_that_it_sinks(error_m_s: float) -> None:
    """Within height / descent rate + 10 s."""
    harness = Harness(pose="mocap")
    harness.fly_offboard(1.0)
    harness.run(0.55, mocap=False)
    harness.autopilot.estimator._x[ekf.VEL + 2] = error_m_s
    seconds, impact = down(harness, 20.0, mocap=False)
    assert not harness.autopilot.armed
    assert seconds < 1.0 / 0.7 + 10.0
    assert impact < 1.5


def test_who_does_not_know_whether_it_climbs_has_landed_after_eight_seconds_without_thrust() -> None:
    """As PX4's MulticopterLandDetector has it: a guard that let it down without poses was refused for ever."""
    harness = Harness(pose="mocap")
    harness.fly_offboard(0.3)
    harness.run(0.1, idle, mocap=False)
    harness.autopilot.estimator._x[ekf.VEL + 2] = -0.8
    harness.run(12.5, idle, mocap=False)  # EKF2_NOAID_TOUT of them
    assert harness.truth.on_ground
    assert harness.autopilot.armed
    harness.run(1.0 + OWN_DELAY_S["px4"], idle, mocap=False)
    assert not harness.autopilot.armed


def test_the_floor_is_felt_by_thrust_and_accelerometer_alone() -> None:
    """Hand computed: at rest 9.8 m/s^2 are felt; with 0.8 of them as thrust the floor gives the rest."""
    contact = ContactDetector()
    contact.update(0, 0.0, 0.0, 0.8 * GRAVITY_M_S2)
    assert contact.update(50 * MS, 0.0, 0.0, 0.8 * GRAVITY_M_S2)
    fallen_m_s = -0.2 * GRAVITY_M_S2 * 0.05
    assert not contact.update(100 * MS, fallen_m_s, fallen_m_s, 0.8 * GRAVITY_M_S2)


def leaping(harness: Harness) -> AttitudeSetpoint:
    """A target that leaps from 40 degrees on one side to 40 on the other, five times a second."""
    side = 1.0 if harness.now_ns // (200 * MS) % 2 else -1.0
    return target(harness, 0.65, from_rotation_vector(np.array([side * np.radians(40.0), 0.0, 0.0])))


def test_a_drone_whose_target_leaps_about_is_not_cut() -> None:
    """Its attitude was 30 degrees and more off for a fifth of a second, as a dead motor's is."""
    about = [1.4 * each for each in PAPER.inertia_kg_m2]
    harness = Harness(pose="mocap", vehicle={"inertia_kg_m2": about})
    harness.fly_offboard(1.5)
    harness.run(1.2, leaping)
    assert harness.autopilot.armed


STIFF: dict[str, object] = {
    "attitude_p_1_s": 11.0, "rate_p_1_s": 45.0, "motor_lag_s": 0.02, "yaw_torque_m": 0.05,
    "inertia_kg_m2": (0.005, 0.005, 0.009), "yaw_p_1_s": 4.0, "rate_yaw_p_1_s": 12.0,
}  # fmt: skip
"""Of a heavy drone whose loops keep it upright on three motors while it spins."""


@pytest.mark.parametrize(
    ("profile", "vehicle", "gain"), [("paper_40g", {}, 0.0), ("paper_40g", {}, 0.3), ("px4_quad", STIFF, 0.0)]
)
def test_a_drone_that_a_dead_motor_turns_over_stops_the_others_in_time(
    profile: str, vehicle: dict[str, object], gain: float
) -> None:
    """A light one tumbles, a heavy one spins and tilts. It took 1.4 s by the ground's rule."""
    harness = Harness(pose="mocap", profile=profile, vehicle=vehicle)
    harness.fly_offboard(1.0, hover_over(0.0, 0.0, 1.0))
    harness.airframe.motor_gain = np.array([gain, 1.0, 1.0, 1.0])
    dead_ns = harness.now_ns
    while harness.autopilot.armed and harness.now_ns < dead_ns + S:
        harness.run(0.01, hover_at(1.0))
    assert harness.now_ns - dead_ns <= 550 * MS
    assert any("motors off" in text for text in harness.texts())


def test_a_heavy_drone_whose_motor_is_weak_spins_and_is_let_down_on_what_is_left() -> None:
    """With 0.3 of one motor it keeps upright, and turns about its own up. Cut it would meet the floor at 4.4 m/s."""
    harness = Harness(pose="mocap", profile="px4_quad", vehicle=STIFF)
    harness.fly_offboard(1.0, hover_over(0.0, 0.0, 1.0))
    harness.airframe.motor_gain = np.array([0.3, 1.0, 1.0, 1.0])
    _, impact = down(harness, 10.0)
    assert not harness.autopilot.armed
    assert impact < 1.5
    assert not any("motors off" in text for text in harness.texts())


def test_forced_arming_of_an_ardupilot_is_refused_while_stopped() -> None:
    harness = Harness(pose="mocap", autopilot="ardupilot")
    harness.run(3.0)
    harness.command(ARM, 0.0, CUT)
    assert harness.command(ARM, 1.0, 2989.0) is Result.TEMPORARILY_REJECTED
    harness.run(2.1)
    assert harness.command(ARM, 1.0, 2989.0) is Result.ACCEPTED


def test_stop_leads_to_stopped_from_everywhere_and_only_rest_leads_on() -> None:
    assert all(TABLE[stage, Trigger.STOP] is Stage.STOPPED for stage in Stage)
    assert {trigger for stage, trigger in TABLE if stage is Stage.STOPPED} == {Trigger.STOP, Trigger.RESTED}


@pytest.mark.parametrize(
    ("profile", "gain", "most_m_s"),
    [("paper_40g", 0.6, 1.5), ("paper_40g", 0.65, 1.5), ("arducopter_quad", 0.44, 1.2), ("px4_quad", 0.55, 1.1)],
)
def test_who_is_level_but_weak_comes_down_on_what_is_left(profile: str, gain: float, most_m_s: float) -> None:
    """With 1.2 of its weight left of 2, or 1.3 of 3; with its motors cut it would meet the floor at 4.4 m/s."""
    harness = Harness(pose="mocap", profile=profile)
    harness.fly_offboard(1.0)
    harness.airframe.motor_gain = np.full(4, gain)
    fastest = 0.0
    for _ in range(300):
        harness.run(0.01, hover_at(1.0))
        fastest = min(fastest, float(harness.truth.vel_lab_m_s[2]))
    assert "Part of its thrust is missing: landing on what is left" in harness.texts()
    assert fastest > -most_m_s
    assert harness.truth.on_ground
    harness.run(3.0)
    assert not harness.autopilot.armed


@pytest.mark.parametrize("weak_s", [0.9, 1.0, 1.1])
def test_motors_that_give_all_again_do_not_throw_it_up(weak_s: float) -> None:
    """Told 2.3 times of what carries it for as long as it takes to feel that."""
    harness = Harness(pose="mocap", profile="arducopter_quad")
    harness.fly_offboard(1.5, hover_over(0.0, 0.0, 1.5))
    harness.airframe.motor_gain = np.full(4, 0.44)
    harness.run(weak_s, hover_at(1.5))
    height_m = float(harness.truth.pos_lab_m[2])
    assert height_m > 0.3
    harness.airframe.motor_gain = np.ones(4)
    highest, impact = height_m, 0.0
    for _ in range(400):
        harness.run(0.01)
        highest = max(highest, float(harness.truth.pos_lab_m[2]))
        impact = min(impact, float(harness.truth.vel_lab_m_s[2]))
    assert highest < height_m + 0.15
    assert impact > -1.2
    assert harness.truth.on_ground


@pytest.mark.parametrize("dodges_s", [0.1, 0.2])
def test_who_is_weak_and_dodges_another_is_not_taken_to_tumble(dodges_s: float) -> None:
    """It turned back to level at 3.05 rad/s as it began to land by itself: cut, it met the floor at 3.6 m/s."""
    harness = Harness(pose="mocap", profile="px4_quad")
    harness.fly_offboard(1.5)
    harness.airframe.motor_gain = np.full(4, 0.6)
    lean = from_rotation_vector(np.array([np.radians(35.0), 0.0, 0.0]))
    for k in range(100):
        harness.run(0.01, (lambda harness: target(harness, 0.52, lean)) if k > 100 * dodges_s else hover_at(1.5))
    assert "Part of its thrust is missing: landing on what is left" in harness.texts()
    assert harness.autopilot.armed
    assert not any("motors off" in text for text in harness.texts())


@pytest.mark.parametrize("scale", [0.6, 1.7])
def test_the_scale_of_the_thrust_is_learned_in_flight_and_tells_the_floor_from_strong_motors(scale: float) -> None:
    """Hovering, a lift of g / scale is modelled. Strong motors alone would feel like a floor for ever."""
    contact = ContactDetector()
    for k in range(100):
        contact.update(k * 50 * MS, 0.0, 0.0, GRAVITY_M_S2 / scale, flies=True)
    assert contact.thrust_scale == pytest.approx(scale, rel=0.01)
    assert not contact.carried
    for k in range(100, 110):
        contact.update(k * 50 * MS, 0.0, 0.0, 0.8 * GRAVITY_M_S2 / scale)
    assert contact.carried
