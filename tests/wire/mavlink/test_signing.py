"""MAVLink signing: pymavlink judges the bytes in both directions; of hostile packets none of 25,000 a kind passes."""

import hashlib
import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as oracle

from wire.link_messages import GROUND, Address, MavCommand, command_long
from wire.mavlink.codec import Codec
from wire.mavlink.framing import FrameCutter
from wire.mavlink.signing import (
    BACKWARDS,
    NOT_WHOLE,
    REPLAYED,
    REVOKED,
    TOO_NEW,
    TOO_OLD,
    UNSIGNED,
    VERSION_1,
    WRONG,
    SigningChannel,
    StampClock,
    stamp_at,
)

NOW_US = 1_795_000_000_000_000  # in November 2026
KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))
MANY = 25_000


def drone_end(key: bytes = KEY, clock: StampClock | None = None) -> SigningChannel:
    """The end of drone 1, which hears everybody but itself."""
    return SigningChannel(key, clock or StampClock(), (1).__ne__)


def ground_end(key: bytes = KEY, clock: StampClock | None = None) -> SigningChannel:
    """The end of the ground, which hears drone 1 alone."""
    return SigningChannel(key, clock or StampClock(), (1).__eq__)


def disarm(codec: Codec, sysid: int = 1) -> bytes:
    """The packet that an attacker would like to have obeyed."""
    return codec.encode(command_long(Address(sysid, 1), MavCommand.COMPONENT_ARM_DISARM, 0.0, 21196.0))


def pymavlink_end(stamp: int, system: int = 255, key: bytes = KEY) -> oracle.MAVLink:
    """pymavlink, signing and demanding signatures."""
    end = oracle.MAVLink(None, srcSystem=system, srcComponent=190)
    end.robust_parsing = True
    end.signing.secret_key, end.signing.timestamp, end.signing.sign_outgoing = key, stamp, True
    end.signing.allow_unsigned_callback = None
    return end


def test_the_signature_is_that_of_the_specification() -> None:
    """SHA-256 over key, packet, link id and stamp, the first six bytes: computed here from the guide's text."""
    codec, channel = Codec(GROUND), ground_end()
    plain = disarm(codec)
    signed = channel.sign(plain, NOW_US)
    assert signed[2] == 1
    assert len(signed) == len(plain) + 13
    stamp = int.from_bytes(signed[-12:-6], "little")
    assert stamp == (NOW_US - 1_420_070_400_000_000) // 10
    assert signed[-6:] == hashlib.sha256(KEY + signed[:-6]).digest()[:6]


def test_pymavlink_accepts_what_is_signed_here() -> None:
    codec, channel, judge = Codec(GROUND), ground_end(), pymavlink_end(stamp_at(NOW_US) - 1, system=1)
    for k in range(500):
        signed = channel.sign(disarm(codec), NOW_US + 1000 * k)
        (message,) = judge.parse_buffer(signed)
        assert message.get_type() == "COMMAND_LONG"
        assert message.get_signed()


def test_what_pymavlink_signs_is_accepted_here() -> None:
    channel, theirs = drone_end(), pymavlink_end(stamp_at(NOW_US))
    for _ in range(500):
        data = bytes(theirs.heartbeat_encode(6, 8, 0, 0, 0).pack(theirs))
        verified = channel.verify(data, NOW_US)
        assert (verified.data, verified.reject_reason) == (data, "")


def hostile(kind: str, codec: Codec, theirs: SigningChannel, rng: random.Random) -> bytes:
    """One packet of an attacker who has heard everything, and has no key of this drone."""
    match kind:
        case "unsigned":
            return disarm(codec)
        case "v1":
            end = oracle.MAVLink(None, srcSystem=255, srcComponent=190)
            message = end.command_long_encode(1, 1, 400, 0, 0.0, 21196.0, 0, 0, 0, 0, 0)
            return bytes(message.pack(end, force_mavlink1=True))
        case "forged":
            return theirs.sign(disarm(codec), NOW_US)[:-6] + rng.randbytes(6)
        case "other key":
            return theirs.sign(disarm(codec), NOW_US)
        case _:  # tampered: one byte of a good packet, anywhere behind the first
            good = bytearray(theirs.sign(disarm(codec), NOW_US))
            good[rng.randrange(1, len(good))] ^= rng.randrange(1, 256)
            return bytes(good)


@pytest.mark.parametrize(
    ("kind", "key", "reasons"),
    [
        ("unsigned", KEY, {UNSIGNED}),
        ("v1", KEY, {VERSION_1}),
        ("forged", KEY, {WRONG}),
        ("other key", OTHER_KEY, {WRONG}),
        ("tampered", KEY, {WRONG, UNSIGNED, NOT_WHOLE, BACKWARDS, TOO_OLD, TOO_NEW, VERSION_1}),
    ],
)
def test_no_hostile_packet_passes(kind: str, key: bytes, reasons: set[str]) -> None:
    """Of MANY, and the link goes on working: the next good packet passes."""
    channel, own, theirs, codec = drone_end(), ground_end(), ground_end(key), Codec(GROUND)
    assert channel.verify(own.sign(disarm(codec), NOW_US), NOW_US).data
    found = set()
    for k in range(MANY):
        verified = channel.verify(hostile(kind, codec, theirs, random.Random(k)), NOW_US)
        assert verified.data == b""
        found.add(verified.reject_reason)
    assert "" not in found
    assert found <= reasons
    assert channel.verify(own.sign(disarm(codec), NOW_US + 10_000_000), NOW_US).data


def test_no_packet_passes_twice_and_none_after_a_restart() -> None:
    channel, own, codec = drone_end(), ground_end(), Codec(GROUND)
    recorded = [own.sign(disarm(codec), NOW_US + 100 * k) for k in range(MANY)]
    assert all(channel.verify(data, NOW_US).data == data for data in recorded)
    assert {channel.verify(data, NOW_US).reject_reason for data in recorded} == {REPLAYED}
    restarted = drone_end(clock=StampClock(floor=channel.clock.newest))
    assert {restarted.verify(data, NOW_US).reject_reason for data in recorded} == {TOO_OLD}
    later = own.sign(disarm(codec), NOW_US + 10_000_000)
    assert restarted.verify(later, NOW_US).data == later


def test_a_packet_of_one_drones_link_passes_on_no_other() -> None:
    two = SigningChannel(OTHER_KEY, StampClock(), (2).__ne__)
    own, codec = ground_end(), Codec(GROUND)
    reasons = {two.verify(own.sign(disarm(codec, 0), NOW_US + k), NOW_US).reject_reason for k in range(MANY)}
    assert reasons == {WRONG}


def test_a_packet_does_not_pass_back_to_where_it_came_from() -> None:
    ground, drone = ground_end(), drone_end()
    down = ground.sign(disarm(Codec(GROUND)), NOW_US)
    up = drone.sign(disarm(Codec(Address(1, 1))), NOW_US)
    assert ground.verify(down, NOW_US).reject_reason == BACKWARDS
    assert drone.verify(up, NOW_US).reject_reason == BACKWARDS
    assert ground.verify(up, NOW_US).data == up


def test_a_machine_without_a_clock_takes_the_other_ends() -> None:
    aboard = SigningChannel(KEY, StampClock(), (1).__ne__, trusts_clock=False)
    boot_us = NOW_US - 400 * 86_400_000_000
    ground = ground_end()
    assert aboard.verify(ground.sign(disarm(Codec(GROUND)), NOW_US), boot_us).data
    answer = aboard.sign(disarm(Codec(Address(1, 1))), boot_us)
    assert ground.verify(answer, NOW_US).data == answer


def test_a_stamp_that_leaves_none_to_sign_with_is_rejected_without_a_clock_too() -> None:
    aboard = SigningChannel(KEY, StampClock(), (1).__ne__, trusts_clock=False)
    thief = pymavlink_end(2**48 - 200)
    assert aboard.verify(bytes(thief.heartbeat_encode(6, 8, 0, 0, 4).pack(thief)), NOW_US).reject_reason == TOO_NEW
    for floor in (0, 2**48):
        assert SigningChannel(KEY, StampClock(floor), (1).__ne__).sign(disarm(Codec(GROUND)), 2**62)


def test_a_stamp_far_ahead_is_rejected_where_the_clock_is_right() -> None:
    ahead = drone_end().sign(disarm(Codec(Address(1, 1))), NOW_US + 61_000_000)
    assert ground_end().verify(ahead, NOW_US).reject_reason == TOO_NEW


def test_of_several_packets_in_a_datagram_the_good_ones_pass() -> None:
    channel, own, codec = drone_end(), ground_end(), Codec(GROUND)
    first, second = own.sign(disarm(codec), NOW_US), own.sign(disarm(codec), NOW_US)
    verified = channel.verify(first + disarm(codec) + second, NOW_US)
    assert verified.data == first + second
    assert verified.reject_reason == UNSIGNED


def test_a_signed_packet_is_signed_anew_by_another_link() -> None:
    inner = SigningChannel(OTHER_KEY, StampClock(), (1).__eq__)
    plain = disarm(Codec(GROUND))
    again = inner.sign(ground_end().sign(plain, NOW_US), NOW_US)
    assert len(again) == len(plain) + 13
    assert drone_end(OTHER_KEY).verify(again, NOW_US).data == again
    assert len(FrameCutter().cut(again)) == 1


def test_the_key_is_in_no_text_of_the_channel() -> None:
    assert KEY.hex() not in repr(ground_end())
    assert str(KEY) not in repr(ground_end())


def test_a_key_of_another_length_is_rejected_without_being_shown() -> None:
    with pytest.raises(ValueError, match="32 bytes") as caught:
        SigningChannel(b"secret", StampClock(), (1).__eq__)
    assert "secret" not in str(caught.value)


def test_a_key_is_replaced_in_flight_and_no_packet_is_lost() -> None:
    """The ground has the new key first and waits for the drone; packets go both ways all the time."""
    ground = ground_end()
    drone = SigningChannel(KEY, StampClock(), (1).__ne__, begins_new_key=True)
    down, up = Codec(GROUND), Codec(Address(1, 1))
    used = []
    for k in range(400):
        if k == 100:
            ground.replace_key(OTHER_KEY)
        if k == 200:
            drone.replace_key(OTHER_KEY)
        now_us = NOW_US + 10_000 * k
        for sender, receiver, codec in ((ground, drone, down), (drone, ground, up)):
            data = sender.sign(disarm(codec), now_us)
            assert receiver.verify(data, now_us).data == data
            used.append(data)
    late = [ground_end(KEY, StampClock(stamp_at(NOW_US) + 1_000_000)).sign(disarm(down), NOW_US)]
    assert drone.verify(late[0], NOW_US).reject_reason == WRONG  # the old key counts no more
    assert {drone.verify(data, NOW_US).data for data in used} == {b""}


def test_a_revoked_key_signs_nothing_and_lets_nothing_in() -> None:
    ground, drone = ground_end(), drone_end()
    data = drone.sign(disarm(Codec(Address(1, 1))), NOW_US)
    ground.replace_key(None)
    assert ground.verify(data, NOW_US).reject_reason == REVOKED
    assert ground.sign(disarm(Codec(GROUND)), NOW_US) == b""


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=400), st.integers(0, 12))
def test_bytes_of_any_content_neither_raise_nor_pass(noise: bytes, cut: int) -> None:
    """Noise alone, and before, after and within a good packet."""
    good = ground_end().sign(disarm(Codec(GROUND)), NOW_US)
    head = b"\xfd" + noise[1:]
    for data in (noise, head, noise + good, good + noise, good[:cut] + noise + good[cut:]):
        verified = drone_end().verify(data, NOW_US)
        assert verified.data in (b"", good)
        assert drone_end().sign(data, NOW_US) is not None
