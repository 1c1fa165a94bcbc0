"""The emulated QTM's answers, held against Qualisys' documentation and read by Qualisys' own client library, qtm-rt."""

import struct

import pytest
from scipy.spatial.transform import Rotation

from sim.cameras.servers.qtm import Discovery, QtmConversation, Subscription

NAMES = ("lead", "<right> & left")
ROTATIONS = Rotation.random(2, random_state=3)


class FakeServer:
    rate_hz = 100.0
    bodies = NAMES


def say(conversation: QtmConversation, words: str) -> tuple[int, str]:
    data = struct.pack(conversation.order + "II", 8 + len(words), 1) + words.encode()
    answer = conversation.received(data)
    if not answer:
        return -1, ""
    size, kind = struct.unpack_from(conversation.order + "II", answer)
    assert size == len(answer)
    return kind, answer[8:].rstrip(b"\0").decode()


@pytest.fixture
def client() -> QtmConversation:
    return QtmConversation("<", "127.0.0.1", FakeServer())


@pytest.mark.parametrize(
    ("words", "kind", "answer"),
    [
        ("Version 1.19", 1, "Version set to 1.19"),
        ("version 1.25", 1, "Version set to 1.25"),
        ("Version 1.26", 0, "Version NOT supported"),
        ("Version 2.0", 0, "Version NOT supported"),
        ("Version", 1, "Version is 1.1"),
        ("ByteOrder", 1, "Byte order is little endian"),
        ("GetState", 6, "\1"),
        ("Reprocess", 0, "Command not supported."),
        ("", 0, "Command not supported."),
        ("StreamFrames AllFrames 3D", 0, "Parse error"),
        ("StreamFrames Frequency:0 6D", 0, "Parse error"),
        ("StreamFrames AllFrames UDP:80 6D", 0, "Parse error"),
        ("GetParameters Force", 0, "Parameters not available"),
    ],
)
def test_commands(client, words, kind, answer):
    assert say(client, words) == (kind, answer)


def test_the_other_byte_order():
    client = QtmConversation(">", "127.0.0.1", FakeServer())
    assert say(client, "ByteOrder") == (1, "Byte order is big endian")
    assert say(client, "Version 1.10") == (1, "Version set to 1.10")


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("StreamFrames AllFrames 6D", Subscription((5,))),
        ("streamframes frequencydivisor:4 6deuler 6dres", Subscription((6, 11), 4)),
        ("StreamFrames Frequency:25 6DEulerRes", Subscription((12,), 4)),
        ("StreamFrames AllFrames UDP:6734 6DEuler", Subscription((6,), 1, ("127.0.0.1", 6734))),
        ("StreamFrames AllFrames UDP:10.0.0.9:6734 6D", Subscription((5,), 1, ("10.0.0.9", 6734))),
    ],
)
def test_what_is_streamed(client, words, wanted):
    assert say(client, words) == (-1, "")
    assert client.wanted == wanted
    say(client, "StreamFrames Stop")
    assert client.wanted is None


def test_what_is_no_packet_ends_the_connection(client):
    with pytest.raises(ValueError, match="no packet has this size"):
        client.received(b"GET / HTTP/1.1\r\n")


def test_a_discovery_is_answered_to_the_port_it_names():
    sent = []

    class Transport:
        def sendto(self, data, to):
            sent.append((data, to))

    discovery = Discovery(22222)
    discovery.connection_made(Transport())
    discovery.datagram_received(b"\x0a\0\0\0\7\0\0\0\x11\xc3", ("10.0.0.9", 9999))
    discovery.datagram_received(b"\x0a\0\0\0\1\0\0\0\x11\xc3", ("10.0.0.9", 9999))
    discovery.datagram_received(b"nonsense", ("10.0.0.9", 9999))
    ((data, to),) = sent
    assert to == ("10.0.0.9", 4547)
    assert struct.unpack_from("<II", data) == (len(data), 1)
    assert data[-3:] == b"\0\x56\xce"
    assert b"QTM" in data
