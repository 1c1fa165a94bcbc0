"""Parameters: types, encodings, lists, unknown names, and the file that keeps them."""

import struct
from pathlib import Path

import pytest

from drone_agent.autopilots import MODELS
from drone_agent.autopilots.parameters import read_parameters, write_parameters
from formation.messages import Datagram
from tests.drone_agent.agent_harness import Harness
from wire.config_file import ConfigError
from wire.link_messages import ParamRequestList, ParamRequestRead, ParamSet, ParamType, ParamValue


def read(harness: Harness, name: str) -> ParamValue:
    harness.send(ParamRequestRead(harness.target, name))
    return harness.last(ParamValue)


def test_ardupilot_casts_and_keeps_its_narrow_types() -> None:
    harness = Harness(sysid=7, autopilot="ardupilot")
    value = read(harness, "SYSID_THISMAV")
    assert (value.raw, value.type) == (struct.pack("<f", 7.0), ParamType.INT16)
    assert read(harness, "GUID_TIMEOUT").type is ParamType.REAL32
    assert read(harness, "VISO_TYPE").type is ParamType.INT8


@pytest.mark.parametrize("autopilot", list(MODELS))
def test_the_whole_list_comes_once_in_order(autopilot: str) -> None:
    harness = Harness(autopilot=autopilot)
    harness.run(0.1)
    harness.send(ParamRequestList(harness.target))
    harness.run(1.0)
    values = harness.of(ParamValue)
    assert [v.index for v in values] == list(range(values[0].count))
    assert len(values) > 60
    names = [v.name for v in values]
    assert names == sorted(names)
    assert all(len(name) <= 16 for name in names)
    harness.send(ParamRequestRead(harness.target, "", 3))
    assert harness.last(ParamValue) == values[3]


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


def test_what_changed_is_handed_out_once_to_be_kept() -> None:
    harness = Harness()
    assert harness.core.tick(0).parameters is None
    data = harness.codec.encode(ParamSet(harness.target, "COM_OF_LOSS_T", struct.pack("<f", 0.5), ParamType.REAL32))
    harness.core.receive(Datagram(1, data), 1)
    kept = harness.core.tick(1).parameters
    assert kept is not None
    assert kept["COM_OF_LOSS_T"] == 0.5
    assert "MIS_TAKEOFF_ALT" not in kept
    assert harness.core.tick(2).parameters is None


def test_the_file_reads_back_what_it_wrote(tmp_path: Path) -> None:
    path = tmp_path / "uav1.parm"
    assert read_parameters(path) == {}
    write_parameters(path, {"B": 0.1, "A": 3.0})
    assert path.read_text() == "A 3\nB 0.1\n"
    assert read_parameters(path) == {"A": 3.0, "B": 0.1}
    path.write_text("A 3 # a comment\n\nB,4\n")
    assert read_parameters(path) == {"A": 3.0, "B": 4.0}


@pytest.mark.parametrize("text", ["A", "A x", "A 1 2"])
def test_a_bad_file_names_its_line(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.parm"
    path.write_text(f"OK 1\n{text}\n")
    with pytest.raises(ConfigError, match=r"bad\.parm:2"):
        read_parameters(path)


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
