"""Which messages are made of a flight's records, with numbers by hand; each is one of its topic's type."""

import math

import numpy as np
import pytest

from formation.codes import Cause, Phase
from formation.config import LabConfig
from formation.messages import Command, Event, LabFrame, PhaseChange, Reference, Severity, SwarmState
from wire.ros2.flight import Flight, diagnostics, fault_status, phase_status, static_frames
from wire.ros2.message_types import message_type

AHEAD_NS = 1_700_000_000_000_000_000
T_NS = 2_000_000_005
STAMP = (1_700_000_002, 5)
QUARTER_LEFT = (math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""w x y z of a quarter turn to the left."""


def lab(*followers: str) -> LabConfig:
    return LabConfig.model_validate(
        {
            "leader": {"body": "robot"},
            "followers": [
                {"body": body, "sysid": sysid, "offset_m": (-1.0, float(sysid), 0.0)}
                for sysid, body in enumerate(followers, 2)
            ],
        }
    )


FLIGHT = Flight(lab("left"))


def rows(*values: tuple[float, ...]) -> np.ndarray:
    return np.array(values, np.float32)


def shown(record: object, flight: Flight = FLIGHT) -> dict[str, tuple]:
    """By topic; each is encoded on the way, which finds values that are not its type's."""
    found = dict(flight.of(record, AHEAD_NS))
    for topic, values in found.items():
        message_type(flight.types[topic]).encode(values)
    return found


def test_a_body_that_is_seen_has_its_pose_and_frame_at_the_exposure_and_another_has_none() -> None:
    q = np.array([QUARTER_LEFT, (1.0, 0.0, 0.0, 0.0)])
    pos = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    frame = LabFrame(1, T_NS, ("robot", "left"), pos, q, np.array([True, False]), T_NS + 7)
    found = shown(frame)
    pose = (1.0, 2.0, 3.0, 0.0, 0.0, *2 * (pytest.approx(math.sqrt(0.5)),))
    assert found == {
        "robot/pose": (*STAMP, "lab", *pose),
        "/tf": (((*STAMP, "lab", "robot", *pose),),),
    }


def test_velocity_is_in_the_body_s_own_axes() -> None:
    """REP-103 and nav_msgs/Odometry: to the north, of a body that looks north, is forward."""
    zeros = np.zeros((2, 3), np.float32)
    one = np.zeros(2, np.float32)
    state = SwarmState(
        T_NS, zeros, rows((0.0, 2.0, 0.5), (0.0, 0.0, 0.0)), zeros, zeros, rows(QUARTER_LEFT, (1.0, 0.0, 0.0, 0.0)),
        one, rows(0.3, 0.0), one, np.array([0.0, math.inf], np.float32), one,
    )  # fmt: skip
    found = shown(state)
    assert set(found) == {"robot/odom"}  # the other was never seen
    values = found["robot/odom"]
    assert values[:4] == (*STAMP, "lab", "robot")
    assert values[11:47] == values[53:] == (0.0,) * 36
    assert values[47:53] == pytest.approx((2.0, 0.0, 0.5, 0.0, 0.0, 0.3), abs=1e-6)


def test_slot_is_target_and_frame_and_the_error_is_in_the_axes_of_the_lab() -> None:
    flight = Flight(lab("left"))
    zeros, none = np.zeros((1, 3), np.float32), np.zeros(1, np.float32)
    reference = Reference(
        T_NS, rows((1.0, 1.0, 1.0)), zeros, zeros, rows(math.pi / 2), none, none, rows((-1.0, 0.5, 0.0)), zeros, zeros,
        none, none, np.array([True]),
    )  # fmt: skip
    found = shown(reference, flight)
    # A metre behind and half a metre to the left of a leader that looks along y.
    pose = pytest.approx((0.5, 0.0, 1.0, 0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)), abs=1e-6)
    assert found["left/target"][:3] == (*STAMP, "lab")
    assert found["left/target"][3:] == pose
    assert found["/tf"][0][0][:4] == (*STAMP, "lab", "slot/left")
    assert found["/tf"][0][0][4:] == pose
    command = Command(T_NS, rows((0.1, 0.0, 0.2)), *(zeros,) * 6, none, none)
    error = shown(command, flight)["left/formation_error"]
    assert error[3:] == pytest.approx((0.0, 0.1, 0.2), abs=1e-6)


def test_battery_alarms_phase_and_what_stands_still_are_of_their_types() -> None:
    fault = Event(Severity.ERROR, "left", "battery at 12 %", lasts=True, code="BATTERY_LOW", subject="left")
    statuses = (
        phase_status(PhaseChange(Phase.HOLD, "operator", Cause.OPERATOR)),
        fault_status(fault, is_over=False),
        fault_status(fault.over(), is_over=True),
    )
    for topic, values in (
        FLIGHT.battery("left", 11.5, None, AHEAD_NS), diagnostics(statuses, AHEAD_NS), static_frames(AHEAD_NS),
    ):  # fmt: skip
        message_type(FLIGHT.types[topic]).encode(values)
    assert [status[0] for status in statuses] == [0, 2, 0]
    assert statuses[1][1] == statuses[2][1]  # the same name, so that the end is that of the fault
    assert statuses[0][2] == "HOLD: operator"


def test_bodies_whose_topics_would_be_one_are_refused() -> None:
    with pytest.raises(ValueError, match=r"a-b, a\.b: the topics of all of them would be a_b"):
        Flight(lab("a-b", "a.b"))


def test_records_of_other_bodies_are_an_error() -> None:
    q, seen = np.array([[1.0, 0.0, 0.0, 0.0]]), np.array([True])
    with pytest.raises(ValueError, match="a frame of robot"):
        list(FLIGHT.of(LabFrame(1, T_NS, ("robot",), np.zeros((1, 3)), q, seen), AHEAD_NS))
    zeros, none = np.zeros((2, 3), np.float32), np.zeros(2, np.float32)
    with pytest.raises(ValueError, match="zip"):
        list(FLIGHT.of(Command(T_NS, zeros, *(zeros,) * 6, none, none), AHEAD_NS))
