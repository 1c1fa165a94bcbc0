"""Parameters: types, encodings, lists, unknown names."""

import struct

import pytest

from drone_agent.autopilots import MODELS
from tests.drone_agent.agent_harness import Harness
from wire.link_messages import ParamRequestRead, ParamSet, ParamType, ParamValue


def read(harness: Harness, name: str) -> ParamValue:
    harness.send(ParamRequestRead(harness.target, name))
    return harness.last(ParamValue)


def test_ardupilot_casts_and_keeps_its_narrow_types() -> None:
    harness = Harness(sysid=7, autopilot="ardupilot")
    value = read(harness, "SYSID_THISMAV")
    assert (value.raw, value.type) == (struct.pack("<f", 7.0), ParamType.INT16)
    assert read(harness, "GUID_TIMEOUT").type is ParamType.REAL32
    assert read(harness, "VISO_TYPE").type is ParamType.INT8


def test_a_foreign_type_or_no_number_changes_nothing() -> None:
    harness = Harness()
    for raw, kind in [(struct.pack("<i", 5), ParamType.INT32), (struct.pack("<f", float("nan")), ParamType.REAL32)]:
        harness.send(ParamSet(harness.target, "MIS_TAKEOFF_ALT", raw, kind))
        assert harness.last(ParamValue).raw == struct.pack("<f", 2.5)


def test_indoor_drones_are_set_up_for_the_external_pose() -> None:
    harness = Harness(pose="mocap")
    assert read(harness, "EKF2_EV_CTRL").raw == struct.pack("<i", 11)
    assert read(harness, "EKF2_GPS_CTRL").raw == struct.pack("<i", 0)
    harness = Harness(pose="mocap", autopilot="ardupilot")
    assert read(harness, "VISO_TYPE").raw == struct.pack("<f", 1.0)


@pytest.mark.parametrize("autopilot", list(MODELS))
@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan")])
def test_a_value_that_is_not_finite_is_refused_with_the_old_one(autopilot: str, value: float) -> None:
    harness = Harness(autopilot=autopilot)
    harness.run(0.1)
    specs = [spec for spec in MODELS[autopilot].table.parameters.values() if spec.type is ParamType.REAL32]
    assert specs
    for spec in specs:
        before = read(harness, spec.name)
        harness.send(ParamSet(harness.target, spec.name, struct.pack("<f", value), spec.type))
        assert harness.last(ParamValue) == before
