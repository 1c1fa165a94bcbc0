import struct

import pytest

from gcs.drones.parameters import KEPT, ParameterReader
from wire.link_messages.address import Address
from wire.link_messages.parameters import ParamType, ParamValue
from wire.link_messages.status import MavAutopilot

DRONE = Address(3, 1)
MS = 1_000_000


def _value(name: str, raw: bytes, kind: ParamType) -> ParamValue:
    return ParamValue(name, raw, kind, 2, 0)


@pytest.mark.parametrize(
    ("autopilot", "raw"), [(MavAutopilot.PX4, struct.pack("<i", 11)), (MavAutopilot.ARDUPILOT, struct.pack("<f", 11.0))]
)
def test_an_integer_is_read_as_its_autopilot_sends_it(autopilot, raw):
    reader = ParameterReader(DRONE, autopilot)
    reader.ask(["EKF2_EV_CTRL"])
    assert [request.name for request in reader.due(0)] == ["EKF2_EV_CTRL"]
    assert reader.receive(_value("EKF2_EV_CTRL", raw, ParamType.INT32))
    assert reader.values == {"EKF2_EV_CTRL": 11.0}
    assert not reader.reading


def test_silent_names_are_asked_six_times_four_at_once_then_given_up():
    reader = ParameterReader(DRONE, MavAutopilot.PX4)
    reader.ask(["A", "B", "C", "D", "E"])
    asked: list[str] = []
    for ms in range(0, 20_000, 10):
        asked += [request.name for request in reader.due(ms * MS)]
    assert asked[:4] == ["A", "B", "C", "D"]
    assert {name: asked.count(name) for name in "ABCDE"} == dict.fromkeys("ABCDE", 6)
    assert not reader.reading
    assert reader.values == {}


def test_announced_changes_are_taken():
    reader = ParameterReader(DRONE, MavAutopilot.PX4)
    reader.receive(_value("COM_OF_LOSS_T", struct.pack("<f", 0.5), ParamType.REAL32))
    assert reader.values == {"COM_OF_LOSS_T": 0.5}


def test_a_type_that_does_not_fit_is_refused():
    reader = ParameterReader(DRONE, MavAutopilot.PX4)
    assert not reader.receive(_value("X", b"\0\0\0\0", ParamType.REAL64))
    assert reader.values == {}


def test_what_nobody_asked_for_does_not_grow_without_bound():
    reader = ParameterReader(DRONE, MavAutopilot.PX4)
    raw = struct.pack("<i", 1)
    taken = [reader.receive(_value(f"P{k}", raw, ParamType.INT32)) for k in range(5000)]
    assert taken == [True] * KEPT + [False] * (5000 - KEPT)
    reader.ask(["WANTED"])
    assert reader.receive(_value("WANTED", raw, ParamType.INT32))
    assert reader.receive(_value("P0", struct.pack("<i", 2), ParamType.INT32))
    assert reader.values["P0"] == 2.0
    assert len(reader.values) == KEPT + 1
