"""Frames of many datagrams in one table: what they hold is what the codec reads of each."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from wire.link_messages import (
    GROUND,
    Address,
    AttitudeQuaternion,
    AttitudeSetpoint,
    Heartbeat,
    Ignore,
    LocalPosition,
    MavAutopilot,
    NamedValue,
)
from wire.mavlink import frames as of_many
from wire.mavlink.codec import Codec
from wire.mavlink.frames import Frames, named_values, setpoints, stamps
from wire.mavlink.framing import FrameCutter, resealed

DRONE = Address(2, 1)


def frames_in(datagrams: list[bytes]) -> Frames:
    return of_many.frames_in(np.frombuffer(b"".join(datagrams), np.uint8), np.array([*map(len, datagrams)], np.int64))


BEAT = Codec(DRONE).encode(Heartbeat(MavAutopilot.PX4, 2, 128, 393216, 4))
SIGNED = (resealed(BEAT, 1) or b"") + bytes(13)
OLD = mavlink.MAVLink_ping_message(1, 2, 0, 0).pack(mavlink.MAVLink(None, 2, 1), force_mavlink1=True)
UNKNOWN = b"\xfd\2\0\0\7\2\1\xff\xff\xff\1\2\0\0"
REAL = st.floats(-4.0, 4.0, width=32) | st.sampled_from([math.nan, math.inf, 0.0])
MASKS = st.integers(0, 255).map(Ignore)


def of(*values: float) -> np.ndarray:
    return np.array(values, np.float64)


def sent(values: list[float], mask: Ignore, target: Address) -> bytes:
    return Codec(GROUND).encode(AttitudeSetpoint(target, 7, of(*values[:4]), of(*values[4:7]), values[7], mask))


@given(
    st.lists(
        st.tuples(st.lists(REAL, min_size=8, max_size=8), MASKS, st.sampled_from([DRONE, Address(3, 1), Address(0, 0)]))
    )
)
def test_setpoints_are_those_that_the_drones_codec_reads(told):
    datagrams = [BEAT + sent(*each) for each in told]
    codec = Codec(DRONE)
    wanted = [
        (k, packet.message)
        for k, datagram in enumerate(datagrams)
        for packet in codec.receive(datagram)
        if isinstance(packet.message, AttitudeSetpoint)
    ]
    found = setpoints(frames_in(datagrams), np.full(len(datagrams), DRONE.system))
    assert found.datagram.tolist() == [k for k, _ in wanted]
    assert found.ignore.tolist() == [int(message.ignore) for _, message in wanted]
    for k, (_, message) in enumerate(wanted):
        assert found.q_lab_from_flu[k].tobytes() == message.q_lab_from_flu.tobytes()
        assert found.rate_flu_rad_s[k].tobytes() == message.rate_flu_rad_s.tobytes()
        assert (found.t_boot_ms[k], found.thrust_norm[k]) == (7, message.thrust_norm)


@given(st.lists(st.lists(REAL, min_size=7, max_size=7)))
def test_stamps_are_those_of_reports_that_the_grounds_codec_reads(told):
    drone, ground = Codec(DRONE), Codec(GROUND)
    datagrams = []
    for k, values in enumerate(told):
        datagrams.append(drone.encode(AttitudeQuaternion(2 * k, of(*values[:4]), of(*values[4:7]))))
        datagrams.append(BEAT + drone.encode(LocalPosition(2 * k + 1, of(*values[:3]), of(*values[3:6]))))
    wanted = [
        packet.message.t_boot_ms
        for datagram in datagrams
        for packet in ground.receive(datagram)
        if isinstance(packet.message, AttitudeQuaternion | LocalPosition)
    ]
    frames, t_boot_ms = stamps(frames_in(datagrams))
    assert t_boot_ms.tolist() == wanted
    assert frames["datagram"].tolist() == wanted


def test_frames_between_noise_have_their_datagram_sender_number_and_bytes():
    drone = Codec(DRONE)
    datagrams = [b"noise", BEAT + b"\xfd\1" + BEAT, b"", BEAT[:-1], drone.encode(NamedValue(0, "age_ms", 12.5))]
    frames = frames_in(datagrams)
    assert frames["datagram"].tolist() == [1, 1, 4]
    assert frames["number"].tolist() == [0, 0, 251]
    assert (frames["system"].tolist(), frames["component"].tolist()) == ([2] * 3, [1] * 3)
    assert list(frames.each()) == [BEAT, BEAT, datagrams[4]]
    named, values = named_values(frames, "age_ms")
    assert (named["datagram"].tolist(), values.tolist()) == ([4], [12.5])
    assert len(named_values(frames, "age")[0]) == 0
    assert len(frames_in([])) == 0


PARTS = st.sampled_from([BEAT, BEAT[:7], b"\xfd", b"\xfe\0", b"noise", SIGNED, OLD, UNKNOWN]) | st.binary(max_size=30)


@given(st.lists(st.lists(PARTS, max_size=12).map(b"".join), max_size=6), st.data())
def test_frames_are_those_that_the_cutter_finds_whatever_is_sent(datagrams, data):
    """Frames of both versions, signed, of no dialect, broken, and more than a datagram may hold."""
    for k, datagram in enumerate(datagrams):
        if datagram and data.draw(st.booleans()):
            altered = bytearray(datagram)
            altered[data.draw(st.integers(0, len(datagram) - 1))] ^= data.draw(st.integers(1, 255))
            datagrams[k] = bytes(altered)
    wanted = [(k, frame) for k, datagram in enumerate(datagrams) for frame in FrameCutter().cut(datagram)]
    found = frames_in(datagrams)
    assert list(found.each()) == [frame.data for _, frame in wanted]
    assert found["datagram"].tolist() == [k for k, _ in wanted]
    assert found["number"].tolist() == [frame.number for _, frame in wanted]
    payloads = zip((found["start"] + found["head"]).tolist(), found["size"].tolist(), strict=True)
    assert [found.data[start : start + size] for start, size in payloads] == [frame.payload for _, frame in wanted]
    senders = zip(found["system"].tolist(), found["component"].tolist(), found["seq"].tolist(), strict=True)
    assert list(senders) == [(*frame.source, frame.seq) for _, frame in wanted]
