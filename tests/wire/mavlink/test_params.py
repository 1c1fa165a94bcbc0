"""Parameter values in their four bytes, PX4's way and ArduPilot's."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wire.link_messages import GROUND, Address, MavAutopilot, ParamType, ParamValue
from wire.mavlink.codec import Codec, param_from_raw, param_to_raw
from wire.mavlink.framing import MavlinkError

RANGES = {
    ParamType.UINT8: (0, 2**8 - 1),
    ParamType.INT8: (-(2**7), 2**7 - 1),
    ParamType.UINT16: (0, 2**16 - 1),
    ParamType.INT16: (-(2**15), 2**15 - 1),
    ParamType.UINT32: (0, 2**32 - 1),
    ParamType.INT32: (-(2**31), 2**31 - 1),
}


def test_px4_sends_the_integers_own_bytes():
    assert param_to_raw(1, ParamType.INT32, MavAutopilot.PX4) == b"\1\0\0\0"
    assert param_to_raw(-1, ParamType.INT32, MavAutopilot.PX4) == b"\xff\xff\xff\xff"


@pytest.mark.parametrize("kind", RANGES)
def test_px4_integers_come_back(kind):
    low, high = RANGES[kind]

    @given(st.integers(low, high))
    def check(value):
        assert param_from_raw(param_to_raw(value, kind, MavAutopilot.PX4), kind, MavAutopilot.PX4) == value

    check()
    for value in (low - 1, high + 1, 0.5):
        with pytest.raises(MavlinkError):
            param_to_raw(value, kind, MavAutopilot.PX4)


@given(st.integers(-(2**24), 2**24))
def test_ardupilot_integers_come_back_as_far_as_a_float_counts(value):
    raw = param_to_raw(value, ParamType.INT32, MavAutopilot.ARDUPILOT)
    read = param_from_raw(raw, ParamType.INT32, MavAutopilot.ARDUPILOT)
    assert raw == struct.pack("<f", value)
    assert read == value
    assert isinstance(read, int)


@given(st.floats(width=32, allow_nan=False), st.sampled_from([MavAutopilot.PX4, MavAutopilot.ARDUPILOT]))
def test_floats_are_floats_everywhere(value, autopilot):
    raw = param_to_raw(value, ParamType.REAL32, autopilot)
    assert raw == struct.pack("<f", value)
    assert param_from_raw(raw, ParamType.REAL32, autopilot) == value


@given(st.binary(min_size=4, max_size=4), st.sampled_from(ParamType), st.sampled_from(MavAutopilot))
def test_any_four_bytes_are_a_value_or_the_one_error(raw, kind, autopilot):
    try:
        value = param_from_raw(raw, kind, autopilot)
    except MavlinkError:
        return
    assert isinstance(value, float if kind is ParamType.REAL32 else int)


@pytest.mark.parametrize("name", ["", "X[/]", "\x1b[2J", "Ü", "A\nB"])
def test_what_is_no_parameters_name_is_refused(name):
    codec = Codec(GROUND)
    assert codec.receive(Codec(Address(7, 1)).encode(ParamValue(name, bytes(4), ParamType.INT32, 1, 0))) == []
    assert codec.bad_packets == 1
