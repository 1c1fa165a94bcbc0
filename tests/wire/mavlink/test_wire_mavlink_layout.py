"""Payload layouts from pymavlink's tables, whichever extension fields its version knows."""

import struct
from types import SimpleNamespace

import pytest

from wire.mavlink import layout as mavlink_layout
from wire.mavlink.layout import layout


def test_fields_go_in_by_documentation_and_out_by_size():
    heartbeat = layout("HEARTBEAT", 6)
    assert heartbeat.payload.format == "<IBBBBB"
    assert heartbeat.pack((2, 12, 81, 0x01020304, 4, 3)) == bytes([4, 3, 2, 1, 2, 12, 81, 4, 3])
    assert heartbeat.unpack(bytes([4, 3, 2, 1, 2, 12, 81, 4, 3])) == (2, 12, 81, 0x01020304, 4, 3)


def test_trailing_zeros_are_cut_but_for_one_byte():
    ping = layout("PING", 4)
    assert ping.pack((1, 0, 0, 0)) == b"\1"
    assert ping.pack((0, 0, 0, 0)) == b"\0"
    assert ping.unpack(b"\1") == (1, 0, 0, 0)


def test_what_a_newer_dialect_appends_is_cut():
    assert layout("HEARTBEAT", 6).unpack(bytes(9) + b"more") == (0,) * 6
    battery = layout("BATTERY_STATUS", 18)  # without its extensions, MAVLink 1's message
    assert battery.payload.size == 36
    assert battery.pack(tuple(range(1, 19))) == layout("BATTERY_STATUS", 26).pack((*range(1, 19), *[0] * 8))


@pytest.mark.parametrize("known", [0, 1, 2])
def test_extensions_are_the_same_bytes_whether_pymavlink_knows_them_or_not(known, monkeypatch):
    """TIMESYNC got a target; pymavlink has it in some versions and not in others."""
    message = SimpleNamespace(
        id=111, crc_extra=34, unpacker=struct.Struct("<qq" + "B" * known), orders=list(range(2 + known))
    )
    monkeypatch.setattr(mavlink_layout.dialect, "MAVLink_timesync_message", message)
    timesync = layout("TIMESYNC", 4, extension="BB")
    assert timesync.pack((1, 2, 3, 4)) == struct.pack("<qqBB", 1, 2, 3, 4)
    assert timesync.unpack(struct.pack("<qqBB", 1, 2, 3, 4)) == (1, 2, 3, 4)


@pytest.mark.parametrize(("name", "count"), [("PING", 5), ("SET_ATTITUDE_TARGET", 6), ("BATTERY_STATUS", 10)])
def test_fields_that_cannot_be_had_are_refused(name, count):
    with pytest.raises(ValueError, match=name):
        layout(name, count)
