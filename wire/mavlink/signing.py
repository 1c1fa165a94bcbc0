"""MAVLink 2 signing: packets signed as they leave a link, and verified as they arrive, before anything reads them.

https://mavlink.io/en/guide/message_signing.html. It belongs to the link and not to the codec, so that no key enters a
core or a log, and a log replays without one. Two rules are stricter than the specification. A stamp counts across
restarts: what was accepted before is never accepted again. The sender's system must be that of the link's other end,
so that no packet can be sent back to where it came from.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, field
from hmac import compare_digest
from typing import NamedTuple

from wire.mavlink.framing import FRAMES_MOST, MAGIC_1, SIGNED, resealed, whole_stop
from wire.security.private_keys import KEY_BYTES

STAMPS_SINCE_US = 1_420_070_400_000_000
"""2015-01-01 UTC; stamps count units of 10 us from there."""
STREAMS_MOST = 32
WINDOW = 6_000_000
"""One minute of stamps: a stream that is not known yet may lie so far behind, any stream so far ahead."""
STAMP_LAST = 1 << 47
"""In 2059: half of what a packet has room for, so that a stamp is always left to sign with."""

NOT_WHOLE = "packet that is no whole MAVLink 2 packet"
VERSION_1 = "MAVLink 1 packet, which has no signature"
UNSIGNED = "packet without a signature"
BACKWARDS = "packet of this end's own system, sent back"
TOO_OLD = "signed packet that is too old"
TOO_NEW = "signed packet from the future of this machine's clock"
WRONG = "packet with a wrong signature"
REPLAYED = "signed packet that came before"
REVOKED = "packet on a link whose key is revoked"
CROWDED = "signed packet of one stream too many"


def stamp_at(unix_us: int) -> int:
    """The stamp of a time."""
    return min(max(unix_us - STAMPS_SINCE_US, 0) // 10, STAMP_LAST)


@dataclass(slots=True)
class StampClock:
    """The newest stamp that a process has signed with or accepted; never goes back.

    floor: the newest that may have been used before this process began (`wire.security.private_keys.StampFile`).
    """

    floor: int = 0
    newest: int = 0

    def __post_init__(self) -> None:
        self.floor = min(self.floor, STAMP_LAST)
        self.newest = max(self.newest, self.floor)

    def next(self, unix_us: int) -> int:
        """A stamp for the next packet: later than every one before."""
        self.newest = max(stamp_at(unix_us), self.newest + 1)
        return self.newest

    def receive(self, stamp: int) -> None:
        """A stamp was accepted: another machine's clock may be ahead."""
        self.newest = max(self.newest, stamp)


class Verification(NamedTuple):
    """The packets of a datagram that are as they must be, byte for byte, and why the others are rejected, if any."""

    data: bytes
    reject_reason: str = ""


@dataclass(slots=True)
class SigningChannel:
    """One end of one drone's link, signed by that drone's own key.

    is_peer: whether a packet of this system may come from the other end. trusts_clock: whether this machine's clock is
    right, so that stamps far ahead of it are rejected; a companion computer without a clock takes the ground's.
    begins_new_key: whether this end is the first to sign with a new key (`replace_key`), the other follows.
    """

    key: bytes = field(repr=False)
    clock: StampClock
    is_peer: Callable[[int], bool]
    link_id: int = 0
    trusts_clock: bool = True
    begins_new_key: bool = False
    _other_key: bytes | None = field(default=None, repr=False)
    _is_revoked: bool = False
    _streams: dict[bytes, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if len(self.key) != KEY_BYTES:
            raise ValueError(f"a signing key has {KEY_BYTES} bytes")

    def replace_key(self, key: bytes | None) -> None:
        """Use a new key from now on; None: the key is revoked, and nothing passes any more, neither way.

        The old key counts until the other end has signed with the new one, so that no packet is lost.
        """
        if key is None or len(key) != KEY_BYTES:
            self._is_revoked = True
        elif key != self.key and key != self._other_key:
            self.key, self._other_key = (key, self.key) if self.begins_new_key else (self.key, key)

    def sign(self, data: bytes, unix_us: int) -> bytes:
        """The packets of a datagram, each with its signature; one that another key has signed is signed anew.

        Bytes that are no MAVLink 2 packet are left out: what cannot be signed is not sent.
        """
        signed, at = [], 0
        if self._is_revoked:
            return b""
        while (stop := whole_stop(data, at)) is not None:
            body = resealed(data[at:stop], SIGNED)
            if body is not None:
                tail = bytes((self.link_id,)) + self.clock.next(unix_us).to_bytes(6, "little")
                signed.append(body + tail + self._signature(body + tail))
            at = stop
        return b"".join(signed)

    def verify(self, data: bytes, unix_us: int) -> Verification:
        """The datagram's packets that are signed by the link's key, later than those before."""
        accepted: list[bytes] = []
        reason, at = "", 0
        for _ in range(FRAMES_MOST):
            if at >= len(data):
                break
            stop = whole_stop(data, at)
            if stop is None:
                return Verification(b"".join(accepted), NOT_WHOLE)
            found = self._reject_reason(data[at:stop], unix_us)
            if found:
                reason = found
            else:
                accepted.append(data[at:stop])
            at = stop
        return Verification(b"".join(accepted), reason or (NOT_WHOLE if at < len(data) else ""))

    def _reject_reason(self, frame: bytes, unix_us: int) -> str:
        """Cheap checks first: a flood of forged packets costs no hashing that it need not."""
        if self._is_revoked:
            return REVOKED
        if frame[0] == MAGIC_1:
            return VERSION_1
        if frame[2] != SIGNED:
            return UNSIGNED
        if not self.is_peer(frame[5]):
            return BACKWARDS
        stamp = int.from_bytes(frame[-12:-6], "little")
        if stamp > (max(stamp_at(unix_us), self.clock.floor) + WINDOW if self.trusts_clock else STAMP_LAST):
            return TOO_NEW
        stream = frame[5:7] + frame[-13:-12]
        before = self._streams.get(stream)
        if before is None and (stamp <= self.clock.floor or stamp < self.clock.newest - WINDOW):
            return TOO_OLD
        if not (self._is_of_own_key(frame) or self._is_of_other_key(frame)):
            return WRONG
        if before is None and len(self._streams) >= STREAMS_MOST:
            return CROWDED
        if before is not None and stamp <= before:
            return REPLAYED
        if self.begins_new_key and self._other_key is not None and self._is_of_own_key(frame):
            self._other_key = None
        self._streams[stream] = stamp
        self.clock.receive(stamp)
        return ""

    def _is_of_own_key(self, frame: bytes) -> bool:
        return compare_digest(self._signature(frame[:-6]), frame[-6:])

    def _is_of_other_key(self, frame: bytes) -> bool:
        """Whether the other key signed it: where that is the new one, it is the key from now on."""
        other = self._other_key
        if other is None or not compare_digest(hashlib.sha256(other + frame[:-6]).digest()[:6], frame[-6:]):
            return False
        if not self.begins_new_key:
            self.key, self._other_key = other, None
        return True

    def _signature(self, signed: bytes) -> bytes:
        """The first 48 bits of SHA-256 over key and packet, link id and stamp included."""
        return hashlib.sha256(self.key + signed).digest()[:6]
