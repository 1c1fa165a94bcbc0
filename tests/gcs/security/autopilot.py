"""pymavlink as an autopilot that signs, and demands signatures as its make does."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from pymavlink.dialects.v20 import ardupilotmega as oracle

from wire.mavlink.signing import stamp_at

NOW_US = 1_795_000_000_000_000
PX4_UNSIGNED = {0, 109, 246, 247}
"""HEARTBEAT, RADIO_STATUS, ADSB_VEHICLE and COLLISION, as PX4's mavlink_sign_control.cpp has them."""


class Autopilot:
    """pymavlink as an autopilot that answers COMMAND_LONG.

    key: what it signs with, None for none. trusts: whether its line is one whose packets it never checks.
    """

    def __init__(self, key: bytes | None, make: int = 12, system: int = 2, *, trusts: bool = False) -> None:
        self.received: list[oracle.MAVLink_setup_signing_message] = []
        self.takes_keys = True
        self._make = make
        self._end = oracle.MAVLink(None, srcSystem=system, srcComponent=1)
        self._end.robust_parsing = True
        if key is not None:
            self.sign_with(key)
        self._end.signing.allow_unsigned_callback = lambda _, number: trusts or number in PX4_UNSIGNED

    def sign_with(self, key: bytes) -> None:
        signing = self._end.signing
        signing.secret_key, signing.timestamp, signing.sign_outgoing = key, stamp_at(NOW_US), True

    def obey(self, data: bytes) -> bytes:
        """Its answers to what it obeys; the key of a SETUP_SIGNING counts from the next packet on."""
        answers = bytearray()
        for message in self._end.parse_buffer(data) or ():
            kind = message.get_type()
            if kind == "HEARTBEAT":
                answers += oracle.MAVLink_heartbeat_message(2, self._make, 0, 0, 4, 3).pack(self._end)
            elif kind == "COMMAND_LONG":
                answers += oracle.MAVLink_command_ack_message(message.command, 0).pack(self._end)
            elif kind == "SETUP_SIGNING" and self.takes_keys:
                self.received.append(message)
                self.sign_with(bytes(message.secret_key))
        return bytes(answers)


@contextmanager
def on_a_line(autopilot: Autopilot) -> Iterator[str]:
    """The device of a serial line to it, a pseudo-terminal, while inside."""
    master, slave = os.openpty()

    def serve() -> None:
        while True:
            try:
                data = os.read(master, 4096)
            except OSError:  # closed below
                return
            os.write(master, autopilot.obey(data))

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        os.close(slave)
        thread.join(5.0)
        os.close(master)
