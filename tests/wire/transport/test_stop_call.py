"""A stop by datagrams: openssl seals the judge's copy; nothing forged, altered, recorded or repeated is a new stop."""

import subprocess
from itertools import count

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from formation.requests import OperatorReply
from wire.transport.stop_call import (
    CHALLENGE,
    LARGEST,
    NO_STOP,
    UNKNOWN,
    WRONG,
    StopReader,
    StopRequest,
    decode_reply,
    encode_stop,
)

KEY, OTHER = bytes(range(32)), bytes(range(1, 33))
ID = 1_795_000_000_000_000
KEYS = {"tool.1": KEY, "anna.2": OTHER}


def reader(run: int = 0) -> StopReader:
    """The ground's end; each run of it draws other challenges."""
    drawn = count(1000 * run + 1)
    return StopReader(KEYS.get, lambda size: next(drawn).to_bytes(size, "big"))


def challenge_of(ground: StopReader) -> bytes:
    """The ground's challenge of tool.1 for its next stop."""
    answer = ground.read(encode_stop("tool.1", KEY, ID, ""))
    assert isinstance(answer, bytes)
    challenge = decode_reply(answer, KEY, ID)
    assert isinstance(challenge, bytes)
    return challenge


def test_the_seal_is_hmac_sha256_as_openssl_computes_it() -> None:
    data = encode_stop("tool.1", KEY, 0x0102030405060708, "anna@tablet")
    body = b"FSTOP1tool.1\0\x01\x02\x03\x04\x05\x06\x07\x08" + bytes(16) + b"anna@tablet"
    command = ("openssl", "dgst", "-sha256", "-mac", "HMAC", "-macopt", f"hexkey:{KEY.hex()}", "-binary")
    assert data == body + subprocess.run(command, input=body, capture_output=True, check=True).stdout


def test_a_stop_is_read_once_and_known_when_it_comes_again() -> None:
    ground = reader()
    data = encode_stop("tool.1", KEY, ID, "anna@tablet", challenge_of(ground))
    assert ground.read(data) == StopRequest("tool.1", ID, "anna@tablet", again=False)
    assert ground.read(data) == StopRequest("tool.1", ID, "anna@tablet", again=True)


def test_every_altered_byte_is_noticed() -> None:
    ground = reader()
    data = encode_stop("tool.1", KEY, ID, "anna@tablet", challenge_of(ground))
    for at in range(len(data)):
        for bit in range(8):
            altered = data[:at] + bytes((data[at] ^ 1 << bit,)) + data[at + 1 :]
            assert isinstance(ground.read(altered), str), (at, bit)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (encode_stop("tool.1", OTHER, ID, ""), WRONG),
        (encode_stop("anna.2", KEY, ID, ""), WRONG),
        (encode_stop("anna.1", OTHER, ID, ""), UNKNOWN),
        (encode_stop("../x.1", KEY, ID, ""), UNKNOWN),
        (encode_stop("tool.1", KEY, ID, "a")[:-1], WRONG),
        (encode_stop("tool.1", KEY, ID, "")[:-1], NO_STOP),
        (encode_stop("tool.1", KEY, ID, "") + bytes(LARGEST), NO_STOP),
        (b"", NO_STOP),
        (b"FSTOP1", NO_STOP),
        (b"FSTOP1tool.1\0", NO_STOP),
        (b"\xfd" * 60, NO_STOP),
    ],
)
def test_what_is_no_new_stop_of_its_name_is_rejected(data: bytes, reason: str) -> None:
    assert reader().read(data) == reason


def test_a_recorded_stop_is_challenged_by_the_same_ground_and_by_one_restarted() -> None:
    ground = reader()
    recorded = encode_stop("tool.1", KEY, ID, "anna@tablet", challenge_of(ground))
    assert isinstance(ground.read(recorded), StopRequest)
    later = encode_stop("tool.1", KEY, ID - 55_000_000, "anna@laptop", challenge_of(ground))  # a clock 55 s behind
    assert isinstance(ground.read(later), StopRequest)
    for again in (ground, reader(run=1)):
        answer = again.read(recorded)
        assert isinstance(answer, bytes)
        assert answer.startswith(CHALLENGE)


@settings(max_examples=300)
@given(st.binary(max_size=LARGEST + 8), st.sampled_from((b"", b"FSTOP1", b"FSTOP1tool.1\0")))
def test_any_bytes_are_read_or_rejected(data: bytes, head: bytes) -> None:
    assert reader().read(head + data) in (NO_STOP, UNKNOWN, WRONG)


def test_only_the_ground_answers_and_only_this_request() -> None:
    ground = reader()
    asked = ground.read(encode_stop("tool.1", KEY, ID, "", challenge_of(ground)))
    assert isinstance(asked, StopRequest)
    reply = ground.reply(asked, OperatorReply(7, True, "STOPPED"))
    assert decode_reply(reply, KEY, ID) == OperatorReply(ID, True, "STOPPED")
    assert decode_reply(reply, OTHER, ID) is None
    assert decode_reply(reply, KEY, ID + 1) is None
    assert decode_reply(encode_stop("tool.1", KEY, ID, ""), KEY, ID) is None
    for at in range(len(reply)):
        assert decode_reply(reply[:at] + bytes((reply[at] ^ 1,)) + reply[at + 1 :], KEY, ID) is None
