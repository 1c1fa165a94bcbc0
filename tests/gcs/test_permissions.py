"""What must hold before the ground does what an operator asks: of the bodies, of each link and its parameters."""

from typing import Any

import numpy as np
import pytest

from formation.reasons import Reason, Reject
from formation.safety.phases import Trigger
from formation.safety.rules import Facts
from gcs import permissions
from gcs.drones.link_state import DroneLink
from gcs.permissions import CONDITIONS, Situation, parameter_warnings
from tests.formation.facts import healthy, of
from tests.gcs.fakes import COPTER_PARAMETERS, PX4_PARAMETERS, triangle
from tests.gcs.link import MS, Drone, a_link, beat, tell
from wire.link_messages import EkfStatus, MavAutopilot


def bodies_ready(facts: Facts, **limits: float) -> tuple[Reject, ...]:
    nothing: Any = None
    lab = triangle(limits=limits)
    return tuple(permissions.bodies_ready(Situation(lab, (), nothing, nothing, frozenset(), facts, 0)))


def autopilot_reasons(link: DroneLink) -> tuple[str, ...]:
    return tuple(reject.text for reject in permissions.autopilot_reasons(link))


def test_every_trigger_of_an_operator_has_its_conditions():
    assert {verb.value for verb in CONDITIONS} >= set(Trigger) - {Trigger.AT_HEIGHT, Trigger.DISARMED}


def test_arming_a_healthy_swarm_is_not_refused():
    assert bodies_ready(healthy(armed=np.zeros(3, bool), offboard=np.zeros(3, bool))) == ()


REFUSALS = {
    "never seen": ({"age_s": of(1, np.inf, 0.0)}, Reason.NO_POSE, "left: no fresh pose (last seen never)"),
    "stale": ({"age_s": of(0, 0.3, 0.0)}, Reason.NO_POSE, "lead: no fresh pose (last seen 0.3 s ago)"),
    "outside": (
        {"pos_lab_m": np.array([[0.0, 0, 0], [2.75, 0, 0], [0, 1, 0]])},
        Reason.OUTSIDE_FENCE,
        "left: 0.25 m outside the fence",
    ),
    "millimetres": (
        {"pos_lab_m": np.array([[0.0, 0, 0], [400.0, 0, 0], [0, 1, 0]])},
        Reason.OUTSIDE_FENCE,
        "left: 397.50 m outside the fence",
    ),
    "tilted": ({"tilt_rad": of(2, 1.0, 0.0)}, Reason.TILTED, "right: tilted by 57 degrees"),
    "carried": ({"speed_m_s": of(2, 0.5, 0.0)}, Reason.MOVING, "right: moving at 0.50 m/s"),
    "silent": ({"heartbeat_age_s": of(2, np.inf, 0.0)}, Reason.NO_HEARTBEAT, "right: no heartbeat (last heard never)"),
    "battery": ({"battery": of(2, 0.15, 1.0)}, Reason.BATTERY_LOW, "right: battery at 15%"),
    "duplicate": (
        {"duplicate": of(2, True, False)},
        Reason.SYSID_TWICE,
        "right: its sysid is used twice on the network",
    ),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_arming_is_refused_with_the_reason(name):
    changes, reason, text = REFUSALS[name]
    (found,) = bodies_ready(healthy(**changes))
    assert (found.reason, found.text) == (reason, text)


def test_the_lab_says_with_which_battery_none_arms():
    facts = healthy(battery=of(2, 0.15, 1.0))
    assert bodies_ready(facts, battery_low_share=0.15) == ()
    assert len(bodies_ready(facts, battery_low_share=0.16)) == 1


def test_two_drones_too_close_are_both_named():
    facts = healthy(pos_lab_m=np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 1, 0]]))
    assert [found.text for found in bodies_ready(facts)] == [
        "lead: 0.10 m from the next body, minimum is 0.20 m",
        "left: 0.10 m from the next body, minimum is 0.20 m",
    ]


def test_a_body_that_is_not_seen_keeps_nobody_else_on_the_floor():
    """Where it was, or the zeros it starts with, are no place: only the lack of its pose is told."""
    beside = np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 1, 0]])
    facts = healthy(pos_lab_m=beside, age_s=of(0, np.inf, 0.0))
    assert bodies_ready(facts) == (Reason.NO_POSE.of("lead", "never"),)


def test_vital_parameters_keep_a_drone_on_the_ground():
    link = a_link()
    assert autopilot_reasons(link) == ()  # a missing heartbeat is reported of the body
    autopilot = MavAutopilot.ARDUPILOT
    Drone().say(link, beat(autopilot))
    assert autopilot_reasons(link) == (
        "left: no estimator report yet",
        "left: GUID_OPTIONS is being read",
        "left: GUID_TIMEOUT is being read",
    )
    Drone().say(link, EkfStatus(0x10, ardupilot=True))
    tell(link, {**COPTER_PARAMETERS, "GUID_OPTIONS": 0}, autopilot)
    assert autopilot_reasons(link) == (
        "left: GUID_OPTIONS is 0, wanted thrust (bit 8): without it our thrust is read as a climb rate",
    )
    # ArduCopter 4.7's default, with which its SITL drifted 5 m.
    tell(link, {**COPTER_PARAMETERS, "GUID_TIMEOUT": 3.0}, autopilot)
    assert [text.split(",")[0] for text in autopilot_reasons(link)] == ["left: GUID_TIMEOUT is 3"]
    tell(link, COPTER_PARAMETERS, autopilot)
    assert autopilot_reasons(link) == ()
    for flags in (0, 0x400, 0x410):
        Drone().say(link, EkfStatus(flags, ardupilot=True))
        assert autopilot_reasons(link) == ("left: estimator has no position yet",)


def test_vital_parameters_that_stay_silent_are_reported_as_unread():
    link = a_link()
    Drone().say(link, beat())
    for ms in range(0, 20_000, 50):
        link.due(ms * MS)
    assert autopilot_reasons(link) == (
        "left: COM_OF_LOSS_T could not be read: how long it flies on after our setpoints stop",
    )


def test_a_velocity_taken_from_gps_is_reported():
    """ArduCopter 4.7 refuses to arm so: "EK3 sources require GPS"."""
    link = a_link()
    Drone().say(link, beat(MavAutopilot.ARDUPILOT))
    tell(link, {**COPTER_PARAMETERS, "EK3_SRC1_VELXY": 3.0}, MavAutopilot.ARDUPILOT)
    assert [name for name, _ in parameter_warnings(link)] == ["EK3_SRC1_VELXY"]


def test_an_autopilot_of_another_kind_is_rejected():
    link = a_link()
    Drone().say(link, beat(MavAutopilot.INVALID))
    assert autopilot_reasons(link) == ("left: autopilot INVALID is neither PX4 nor ArduPilot",)


def test_lesser_parameters_only_warn():
    link = a_link()
    Drone().say(link, beat())
    tell(link, {**PX4_PARAMETERS, "EKF2_EV_CTRL": 0, "COM_OBL_RC_ACT": 0, "MPC_THR_HOVER": 0.3}, MavAutopilot.PX4)
    assert autopilot_reasons(link) == ()
    assert [name for name, _ in parameter_warnings(link)] == ["COM_OBL_RC_ACT", "EKF2_EV_CTRL", "MPC_THR_HOVER"]
