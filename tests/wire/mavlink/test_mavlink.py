"""The codec against itself and against pymavlink."""

import math
import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as oracle

from tests.wire.messages import ANY_MESSAGE, MESSAGES, assert_same, decode_packet
from wire.link_messages import (
    GROUND,
    Address,
    AttitudeSetpoint,
    CommandLong,
    EstimatorType,
    GlobalPosition,
    Heartbeat,
    Ignore,
    LinkMessage,
    MavAutopilot,
    NamedValue,
    Odometry,
    OdometryFrame,
    Packet,
    ParamRequestList,
    ParamSet,
    ParamValue,
    SetMode,
    SetOrigin,
    SysStatus,
    TimeSync,
    UnknownMessage,
)
from wire.mavlink.codec import Codec
from wire.mavlink.framing import MavlinkError

DRONE = Address(7, 1)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
ZERO = np.zeros(3)


def setpoint(**changes) -> AttitudeSetpoint:
    values = {"target": DRONE, "t_boot_ms": 5, "q_lab_from_flu": LEVEL, "rate_flu_rad_s": ZERO, "thrust_norm": 0.5}
    return AttitudeSetpoint(**{**values, "ignore": Ignore.NONE, **changes})


def decoded(message) -> LinkMessage:
    (packet,) = everything_for(message).receive(Codec(DRONE).encode(message))
    return packet.message


def everything_for(message) -> Codec:
    """A codec that the message, whoever its target, is addressed to."""
    target = getattr(message, "target", Address(getattr(message, "target_system", 0), 0))
    return Codec(target)


def test_every_link_message_has_a_strategy():
    assert set(MESSAGES) == set(LinkMessage.__args__) - {UnknownMessage}


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_a_message_comes_back_and_its_bytes_are_pymavlinks(kind):
    """pymavlink reads every packet, and writes what it has read as the same bytes."""

    @given(MESSAGES[kind], st.integers(0, 255))
    def check(message, seq):
        codec = everything_for(message)
        (packet,) = codec.receive(Codec(DRONE).encode(message))
        assert packet.source == DRONE
        assert_same(message, packet.message)
        assert (codec.bad_bytes, codec.bad_packets, codec.misaddressed_packets) == (0, 0, 0)
        if kind is TimeSync:
            message = TimeSync(message.tc1_ns, message.ts1_ns)  # pymavlink has no target there yet
        if kind in (ParamValue, ParamSet):
            number = struct.unpack("<f", message.raw)[0]  # a float's NaN loses its bits in pymavlink
            message = type(message)(
                **{n: getattr(message, n) for n in message.__slots__} | {"raw": struct.pack("<f", number)}
            )
        codec = Codec(DRONE)
        for _ in range(seq):
            codec.encode(ParamRequestList(DRONE))
        data = codec.encode(message)
        mav = oracle.MAVLink(None, srcSystem=DRONE.system, srcComponent=DRONE.component)
        mav.robust_parsing = False
        read = mav.parse_buffer(data)
        mav.seq = seq
        again = b""
        for packet in read:
            again += packet.pack(mav)
            mav.seq = (mav.seq + 1) % 256
        assert again == data

    check()


@given(st.binary(max_size=600))
def test_any_bytes_are_read_or_skipped_and_the_next_datagram_is_read_at_once(garbage):
    codec = Codec(GROUND)
    codec.receive(garbage)
    assert codec.bad_bytes <= len(garbage)
    heartbeat = Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4)
    assert codec.receive(Codec(DRONE).encode(heartbeat)) == [Packet(DRONE, 0, heartbeat)]


@given(ANY_MESSAGE, st.data())
def test_a_flipped_bit_never_reads_as_another_message(message, data):
    """A checksum sees every single flipped bit, unless it turns the id into one that nobody can check."""
    frame = bytearray(Codec(DRONE).encode(message))
    bit = data.draw(st.integers(0, 8 * len(frame) - 1))
    frame[bit // 8] ^= 1 << bit % 8
    try:
        packet = decode_packet(bytes(frame))
    except MavlinkError:
        return
    assert isinstance(packet.message, UnknownMessage)
    assert packet.message.message_id not in oracle.mavlink_map


@given(st.sampled_from(sorted(oracle.mavlink_map)), st.binary(min_size=1, max_size=255))
def test_any_payload_of_any_known_message_is_read_or_the_one_error(number, payload):
    """Right checksum, impossible content: enumerations, quaternions, NaN."""
    frame = sealed(number, payload)
    try:
        packet = decode_packet(frame)
    except MavlinkError:
        packet = None
    codec = Codec(GROUND)
    taken = codec.receive(frame)
    assert codec.bad_bytes == 0
    assert codec.bad_packets == (packet is None)
    assert len(taken) + codec.misaddressed_packets + codec.bad_packets <= 1


def sealed(number: int, payload: bytes, flags: int = 0) -> bytes:
    head = struct.pack("<BBBBBBBHB", 0xFD, len(payload), flags, 0, 0, 7, 1, number & 0xFFFF, number >> 16)
    extra = oracle.mavlink_map[number].crc_extra if number in oracle.mavlink_map else 0
    crc = oracle.x25crc(head[1:] + payload + bytes([extra])).crc
    return head + payload + struct.pack("<H", crc) + bytes(13 if flags else 0)


def test_mavlink_1_is_read():
    """mavutil starts in MAVLink 1 until it has heard MAVLink 2."""
    mav = oracle.MAVLink(None, srcSystem=7, srcComponent=1)
    frame = mav.heartbeat_encode(2, 12, 81, 50593792, 4).pack(mav, force_mavlink1=True)
    assert frame[0] == 0xFE
    heartbeat = Heartbeat(MavAutopilot.PX4, 2, 81, 50593792, 4)
    assert decode_packet(frame) == Packet(DRONE, 0, heartbeat)
    assert Codec(GROUND).receive(frame + frame)[1].message == heartbeat


def test_a_signed_packet_is_read_without_asking_for_its_signature():
    frame = sealed(0, bytes([0, 0, 0, 0, 2, 12, 0, 4, 3]), flags=1)
    assert decode_packet(frame).message == Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4)


def test_an_unknown_incompatibility_flag_is_refused():
    with pytest.raises(MavlinkError):
        decode_packet(sealed(0, bytes(9), flags=2))


def test_a_message_of_no_dialect_is_unknown_and_its_neighbours_are_read():
    """PX4 sends ids that no published dialect has; its checksum cannot be checked."""
    heartbeat = Codec(DRONE).encode(Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4))
    codec = Codec(GROUND)
    packets = codec.receive(heartbeat + sealed(54321, b"abc") + heartbeat)
    assert [type(p.message) for p in packets] == [Heartbeat, UnknownMessage, Heartbeat]
    assert codec.bad_bytes == 0


@pytest.mark.parametrize(
    ("target", "taken"),
    [((7, 1), True), ((7, 0), True), ((0, 1), True), ((7, 25), False), ((8, 1), False)],
)
def test_only_packets_for_this_address_or_everybody_are_taken(target, taken):
    codec = Codec(DRONE)
    packets = codec.receive(Codec(GROUND).encode(CommandLong(Address(*target), 400, (1.0,) * 7)))
    assert (len(packets), codec.misaddressed_packets) == ((1, 0) if taken else (0, 1))
    assert codec.receive(Codec(GROUND).encode(SetMode(8, 1, 4))) == []


@pytest.mark.parametrize(
    "message",
    [
        NamedValue(0, "eleven char", 1.0),
        ParamRequestList(Address(256, 1)),
        setpoint(thrust_norm=1e39),
        SetOrigin(3, math.nan, 8.0, 0.0),
        UnknownMessage(4242),
    ],
    ids=["name too long", "no such system", "no such float", "no number", "unknown"],
)
def test_what_mavlink_cannot_carry_is_the_one_error(message):
    with pytest.raises(MavlinkError):
        Codec(GROUND).encode(message)


def test_boot_time_wraps_after_49_days():
    assert decoded(setpoint(t_boot_ms=2**32 + 5)).t_boot_ms == 5


@pytest.mark.parametrize(
    "change",
    [
        {"q_lab_from_flu": np.zeros(4)},
        {"q_lab_from_flu": np.array([math.inf, 0, 0, 0])},
        {"thrust_norm": math.nan},
        {"rate_flu_rad_s": np.array([0, math.inf, 0])},
    ],
)
def test_a_setpoint_that_is_no_rotation_or_not_finite_is_refused(change):
    codec = Codec(DRONE)
    assert codec.receive(Codec(GROUND).encode(setpoint(**change))) == []
    assert codec.bad_packets == 1


def test_ignored_parts_of_a_setpoint_may_be_anything():
    ignore = Ignore.ATTITUDE | Ignore.THRUST | Ignore.ROLL_RATE
    rates = np.array([math.nan, 0.5, -0.25])
    message = setpoint(q_lab_from_flu=np.zeros(4), rate_flu_rad_s=rates, thrust_norm=math.nan, ignore=ignore)
    read = decoded(message)
    assert read.ignore == ignore
    np.testing.assert_array_equal(read.q_lab_from_flu, LEVEL)
    np.testing.assert_array_equal(read.rate_flu_rad_s, [0.0, 0.5, -0.25])
    assert read.thrust_norm == 0.0


def test_a_quaternion_with_negative_w_is_the_same_rotation():
    """PX4 sends w = -1 at times."""
    read = decoded(setpoint(q_lab_from_flu=np.array([-0.6, 0.0, 0.8, 0.0])))
    np.testing.assert_allclose(read.q_lab_from_flu, [0.6, 0.0, -0.8, 0.0], atol=1e-7)


def test_unknown_battery_figures_are_nan():
    read = decoded(SysStatus(1, 1, 1, 0.25, math.nan, math.nan, math.nan))
    assert (read.load, math.isnan(read.battery_v), math.isnan(read.battery_a)) == (0.25, True, True)
    assert math.isnan(read.battery_remaining)


def test_odometry_with_its_velocity_in_the_world_is_nothing_bad():
    """PX4's own telemetry, some thirty a second."""
    payload = oracle.MAVLink(None).odometry_encode(1, 1, 1, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0, 0, 0, 0, [0] * 21, [0] * 21)
    codec = Codec(GROUND)
    packets = codec.receive(payload.pack(oracle.MAVLink(None, srcSystem=1, srcComponent=1)))
    assert [packet.message for packet in packets] == [UnknownMessage(331)]
    assert (codec.bad_packets, codec.bad_bytes) == (0, 0)


def test_unknown_odometry_velocity_stays_nan():
    nan = np.full(3, math.nan)
    message = Odometry(1, OdometryFrame.LOCAL_FRD, EstimatorType.VISION, ZERO, LEVEL, nan, nan)
    read = decoded(message)
    assert np.isnan(read.vel_flu_m_s).all()
    assert np.isnan(read.rate_flu_rad_s).all()


@pytest.mark.parametrize(("tc1_ns", "taken"), [(5, 1), (0, 0)])
def test_an_answered_timesync_is_taken_whatever_its_target(tc1_ns, taken):
    """PX4 1.16.1 fills in neither target of its answers: 24/54, 128/72 and 160/205 were seen of it."""
    ground = Codec(GROUND)
    packets = ground.receive(Codec(Address(1, 1)).encode(TimeSync(tc1_ns, 7, Address(24, 54))))
    assert (len(packets), ground.misaddressed_packets) == (taken, 1 - taken)


def test_what_an_end_does_not_read_is_unknown_to_it_and_costs_no_reading():
    drone = Codec(DRONE)
    codec = Codec(GROUND, reads=frozenset({0}))
    beat = Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4)
    assert [p.message for p in codec.receive(drone.encode(beat) + drone.encode(NamedValue(0, "x", 1.0)))] == [
        beat, UnknownMessage(251),
    ]  # fmt: skip


@pytest.mark.parametrize("speed_m_s", [327.0, 1e30])
def test_a_drone_faster_than_the_field_holds_is_told_at_its_end(speed_m_s):
    """It flew on; the packet that could not be made ended its agent."""
    far = GlobalPosition(1, 47.0, 8.0, 1e9, -1e9, np.array([speed_m_s, 0.0, -speed_m_s]), None)
    (packet,) = Codec(GROUND).receive(Codec(Address(3, 1)).encode(far))
    assert packet.message.vel_lab_m_s[0] == pytest.approx(min(speed_m_s, 327.67))
    assert packet.message.alt_m == pytest.approx(2**31 * 1e-3)
