"""QTM's packets, against bytes written by hand from the tables of the QTM RT protocol documentation."""

import struct

import pytest

from mocap.sources.qualisys import Stream, bodies_of, command, names_of
from mocap.sources.tcp import LARGEST_PACKET, ProtocolError
from tests.mocap.sources.qtm_bytes import FRAME


def test_a_command_is_the_documentations_example():
    assert command("Version 1.2") == b"\x14\0\0\0\1\0\0\0Version 1.2\0"


@pytest.mark.parametrize(
    ("size", "kind", "why"),
    [(7, 3, "a size"), (LARGEST_PACKET + 1, 3, "a size"), (8, 9, "a type")],
)
def test_what_is_no_stream(size, kind, why):
    with pytest.raises(ProtocolError, match=f"packet header: {why} that no packet has"):
        Stream().receive(struct.pack("<II", size, kind))


def with_value(at: int, form: str, value: int) -> bytes:
    packet = bytearray(FRAME[8:])
    struct.pack_into("<" + form, packet, at, value)
    return bytes(packet)


COMPONENTS_AT, SIZE_AT, TYPE_AT, BODIES_AT = 12, 16, 20, 24


@pytest.mark.parametrize(
    ("packet", "why"),
    [
        (FRAME[8:23], "data packet: cut short"),
        (with_value(COMPONENTS_AT, "I", 2**32 - 1), "a component count that no packet has"),
        (with_value(COMPONENTS_AT, "I", 32), "components that cannot be read"),
        (with_value(TYPE_AT, "I", 99), "components that cannot be read"),
        (with_value(SIZE_AT, "I", 2**32 - 1), "body count and size do not agree"),
        (with_value(BODIES_AT, "i", 2**31 - 1), "a body count that no laboratory has"),
        (with_value(BODIES_AT, "i", 3), "body count and size do not agree"),
        (FRAME[8:32], "6D component: cut short"),
        (FRAME[8:-1], "body count and size do not agree"),
    ],
)
def test_what_cannot_be_read_is_named(packet, why):
    with pytest.raises(ValueError, match=why):
        bodies_of(packet)


@pytest.mark.parametrize(
    ("parameters", "why"),
    [
        ("<a><The_6D>", "not XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "a document type"),
        ("<a><The_6D><Body><Mesh><Name>x</Name></Mesh></Body></The_6D></a>", "a body without a name"),
        ("<a><The_6D>" + 1001 * "<Body/>" + "</The_6D></a>", "more bodies than any laboratory has"),
    ],
)
def test_parameters_that_cannot_be_read(parameters, why):
    with pytest.raises(ValueError, match=why):
        names_of(parameters)
