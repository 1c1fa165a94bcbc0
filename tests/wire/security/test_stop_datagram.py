"""A stop in one datagram: openssl seals the judge's copy; nothing forged, altered, old or repeated is a new stop."""

import subprocess

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from formation.requests import OperatorReply
from wire.security.stop_datagram import (
    LARGEST,
    NO_STOP,
    OLD,
    UNKNOWN,
    WINDOW_US,
    WRONG,
    StopAsked,
    StopReader,
    decode_reply,
    encode_stop,
)

KEY, OTHER = bytes(range(32)), bytes(range(1, 33))
NOW_US = 1_795_000_000_000_000
KEYS = {"tool.1": KEY, "anna.2": OTHER}
MANY = 25_000


def reader(begun_us: int = NOW_US - 1) -> StopReader:
    return StopReader(KEYS.get, begun_us)


def test_the_seal_is_hmac_sha256_as_openssl_computes_it() -> None:
    data = encode_stop("tool.1", KEY, 0x0102030405060708, "anna@tablet")
    body = b"FSTOP1tool.1\0\x01\x02\x03\x04\x05\x06\x07\x08anna@tablet"
    command = ("openssl", "dgst", "-sha256", "-mac", "HMAC", "-macopt", f"hexkey:{KEY.hex()}", "-binary")
    assert data == body + subprocess.run(command, input=body, capture_output=True, check=True).stdout


def test_a_stop_is_read_once_and_known_when_it_comes_again() -> None:
    ground, data = reader(), encode_stop("tool.1", KEY, NOW_US, "anna@tablet")
    assert ground.read(data, NOW_US) == StopAsked("tool.1", NOW_US, "anna@tablet", again=False)
    assert ground.read(data, NOW_US + 20_000) == StopAsked("tool.1", NOW_US, "anna@tablet", again=True)


def test_every_altered_byte_is_noticed() -> None:
    data = encode_stop("tool.1", KEY, NOW_US, "anna@tablet")
    for at in range(len(data)):
        for bit in range(8):
            altered = data[:at] + bytes((data[at] ^ 1 << bit,)) + data[at + 1 :]
            assert isinstance(reader().read(altered, NOW_US), str), (at, bit)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (encode_stop("tool.1", OTHER, NOW_US, ""), WRONG),
        (encode_stop("anna.2", KEY, NOW_US, ""), WRONG),
        (encode_stop("anna.1", OTHER, NOW_US, ""), UNKNOWN),
        (encode_stop("../x.1", KEY, NOW_US, ""), UNKNOWN),
        (encode_stop("tool.1", KEY, NOW_US - WINDOW_US - 1, ""), OLD),
        (encode_stop("tool.1", KEY, NOW_US + WINDOW_US + 1, ""), OLD),
        (encode_stop("tool.1", KEY, NOW_US, "a")[:-1], WRONG),
        (encode_stop("tool.1", KEY, NOW_US, "")[:-1], NO_STOP),
        (encode_stop("tool.1", KEY, NOW_US, "") + bytes(LARGEST), NO_STOP),
        (b"", NO_STOP),
        (b"FSTOP1", NO_STOP),
        (b"FSTOP1tool.1\0", NO_STOP),
        (b"\xfd" * 60, NO_STOP),
    ],
)
def test_what_is_no_new_stop_of_its_name_is_rejected(data: bytes, reason: str) -> None:
    assert reader(NOW_US - 2 * WINDOW_US).read(data, NOW_US) == reason


def test_what_was_sent_before_the_ground_began_or_before_the_newest_is_old() -> None:
    early, late = (encode_stop("tool.1", KEY, NOW_US + k, "") for k in (0, 5))
    assert reader(NOW_US + 1).read(early, NOW_US + 2) == OLD
    ground = reader()
    assert isinstance(ground.read(late, NOW_US + 5), StopAsked)
    assert ground.read(early, NOW_US + 6) == OLD


def test_of_many_forged_ones_none_is_obeyed() -> None:
    ground, true = reader(), encode_stop("tool.1", KEY, NOW_US, "anna@tablet")
    for k in range(MANY):
        seal = k.to_bytes(32, "big")
        assert ground.read(true[:-32] + seal, NOW_US) == WRONG


@settings(max_examples=300)
@given(st.binary(max_size=LARGEST + 8), st.sampled_from((b"", b"FSTOP1", b"FSTOP1tool.1\0")))
def test_any_bytes_are_read_or_rejected(data: bytes, head: bytes) -> None:
    assert reader().read(head + data, NOW_US) in (NO_STOP, UNKNOWN, WRONG, OLD)


def test_only_the_ground_answers_and_only_this_request() -> None:
    ground = reader()
    asked = ground.read(encode_stop("tool.1", KEY, NOW_US, ""), NOW_US)
    assert isinstance(asked, StopAsked)
    reply = ground.reply(asked, OperatorReply(7, True, "STOPPED"))
    assert decode_reply(reply, KEY, NOW_US) == OperatorReply(NOW_US, True, "STOPPED")
    assert decode_reply(reply, OTHER, NOW_US) is None
    assert decode_reply(reply, KEY, NOW_US + 1) is None
    assert decode_reply(encode_stop("tool.1", KEY, NOW_US, ""), KEY, NOW_US) is None
    for at in range(len(reply)):
        assert decode_reply(reply[:at] + bytes((reply[at] ^ 1,)) + reply[at + 1 :], KEY, NOW_US) is None
