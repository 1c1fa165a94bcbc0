import numpy as np
import pytest

from mocap.sources.natnet import packets
from mocap.sources.natnet.packets import MessageId, PacketError, frame_of_data, rigid_bodies
from tests.mocap.sources import natnet_packets as outside

VERSIONS = [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]


def payload(data: bytes) -> bytes:
    return packets.unpack(data)[1]


def test_server_info():
    info = packets.server_info(payload(outside.SERVER_INFO))
    assert info == packets.ServerInfo("Motive", (2, 1, 0, 0), (3, 0), outside.FREQUENCY_HZ, 1511, "239.255.42.99")
    assert info.text == "Motive 2.1, NatNet 3.0"


def test_echoes_and_requests():
    assert packets.echo_request(outside.TOKEN) == outside.ECHO_REQUEST
    assert packets.echo_response(payload(outside.ECHO_RESPONSE)) == (outside.TOKEN, outside.ANSWERED_TICKS)
    assert packets.hello(MessageId.DISCOVERY, "NatNetLib") == outside.DISCOVERY
    assert packets.packet(MessageId.REQUEST_MODELS) == outside.MODELS_REQUEST


@pytest.mark.parametrize("version", VERSIONS)
def test_a_frame_with_every_section_and_models_of_every_type_are_read(version):
    frame = frame_of_data(payload(outside.whole_frame(version, params=2)), version)
    assert (frame.number, frame.exposure_ticks, frame.params) == (outside.NUMBER, outside.EXPOSURE, 2)
    for row, (number, pos, q, params) in zip(frame.bodies, outside.BODIES, strict=True):
        assert (row["id"], row["params"]) == (number, params)
        np.testing.assert_array_equal(row["pose"], np.float32([*pos, *q]))
    assert rigid_bodies(payload(outside.whole_models(version)), version) == list(outside.NAMES.items())


@pytest.mark.parametrize("version", [(3, 0), (4, 2)])
def test_a_packet_that_is_cut_or_too_long_is_rejected(version):
    for read, data in ((frame_of_data, outside.whole_frame(version)), (rigid_bodies, outside.whole_models(version))):
        whole = payload(data)
        for end in range(len(whole)):
            with pytest.raises(PacketError):
                read(whole[:end], version)
        with pytest.raises(PacketError, match="longer than its content"):
            read(whole + bytes(4), version)


@pytest.mark.parametrize("spoken", [(4, 0), (4, 1)])
@pytest.mark.parametrize("believed", [(3, 0), (4, 2)])
def test_a_frame_of_another_layout_is_rejected_and_never_misread(spoken, believed):
    data = payload(outside.whole_frame(spoken))
    if (spoken >= (4, 1)) == (believed >= (4, 1)):
        assert len(frame_of_data(data, believed).bodies) == 2
    else:
        with pytest.raises(PacketError):
            frame_of_data(data, believed)


@pytest.mark.parametrize("version", [(3, 0), (4, 2)])
@pytest.mark.parametrize("count", [-1, 2**31 - 1])
def test_a_number_of_any_size_anywhere_is_rejected_or_leaves_the_rest_readable(version, count):
    """Counts and byte counts among them: nothing else is raised, and nothing read outside the packet."""
    number = count.to_bytes(4, "little", signed=True)
    for read, data in ((frame_of_data, outside.whole_frame(version)), (rigid_bodies, outside.whole_models(version))):
        whole, refused = payload(data), 0
        for at in range(len(whole) - 3):
            try:
                read(whole[:at] + number + whole[at + 4 :], version)
            except PacketError:
                refused += 1
        assert refused > 10
    with pytest.raises(PacketError, match="marker sets: more than the packet holds"):
        frame_of_data(payload(outside.whole_frame((3, 0)))[:4] + number + bytes(400), (3, 0))


def test_byte_count_and_count_of_bodies_must_agree():
    whole = bytearray(payload(outside.whole_frame((4, 1))))
    at = whole.index(bytes((2, 0, 0, 0, 76, 0, 0, 0)))  # two bodies of 38 bytes
    whole[at] = 1
    with pytest.raises(PacketError, match="count and byte count differ"):
        frame_of_data(bytes(whole), (4, 1))


@pytest.mark.parametrize("data", [b"", b"\7\0", b"\7\0\5\0abcd", b"\7\0\3\0abcd"])
def test_a_header_must_tell_the_packets_length(data):
    with pytest.raises(PacketError, match=r"^packet: "):
        packets.unpack(data)


@pytest.mark.parametrize(
    ("at", "value", "why"), [(260, b"\2", "older than 3.0"), (264, bytes(8), "clock frequency"), (270, b"", "beyond")]
)
def test_a_server_without_a_clock_is_rejected(at, value, why):
    info = payload(outside.SERVER_INFO)
    with pytest.raises(PacketError, match=why):
        packets.server_info(info[:at] + value + (info[at + len(value) :] if value else b""))


@pytest.mark.parametrize(
    ("answer", "version"),
    [(b"Bitstream,4.1.0\0", (4, 1)), (b"Bitstream,4\0", None), (b"Bitstream,4.x\0", None), (b"\0\0\xf0B", None)],
)
def test_the_streams_version_is_read_from_an_answer(answer, version):
    assert packets.stream_version(answer) == version
