"""MAVLink over a serial line, one drone a line, read straight from the event loop."""

import asyncio

import serial

from formation.messages import Datagram
from wire import clock
from wire.mavlink.signing import SigningChannel
from wire.transport.link import Deliver, LinkCounters


class SerialLink:
    """The line of the drone `sysid`; what is read is a stream, cut anywhere.

    `channel`: signs what is sent, for an autopilot that demands it. What is read is not verified: a cable leads there.
    """

    def __init__(
        self, device: str, baud: int, sysid: int, deliver: Deliver, channel: SigningChannel | None = None
    ) -> None:
        """Open the line (OSError)."""
        self._channel = channel
        self.counters = LinkCounters()
        self._sysid = sysid
        self._deliver = deliver
        self._loop = asyncio.get_running_loop()
        self._port = serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
        self._loop.add_reader(self._port.fileno(), self._read)

    def send(self, datagram: Datagram) -> None:
        """Hand bytes to the line; what does not fit its buffer is lost and counted."""
        data = datagram.data if self._channel is None else self._channel.sign(datagram.data, clock.unix_us())
        try:
            self._port.write(data)
            self.counters.sent += 1
        except (serial.SerialTimeoutException, BlockingIOError):
            self.counters.dropped += 1

    def close(self) -> None:
        """Close the line."""
        self._loop.remove_reader(self._port.fileno())
        self._port.close()

    def _read(self) -> None:
        data = self._port.read(4096)
        if data:
            self.counters.received += 1
            self._deliver(Datagram(self._sysid, data))


def device_and_baud(line: str) -> tuple[str, int]:
    """Device and baud rate of the line "serial:DEV:BAUD"; ValueError for text that is none."""
    kind, _, where = line.partition(":")
    device, _, baud = where.rpartition(":")
    if kind != "serial" or not device or not baud.isdecimal():
        raise ValueError(f"{line!r} is not serial:DEV:BAUD")
    return device, int(baud)


async def open_serial(line: str, sysid: int, deliver: Deliver, channel: SigningChannel | None = None) -> SerialLink:
    """The line "serial:DEV:BAUD". OSError where it cannot be opened; ValueError for text that is no line."""
    return SerialLink(*device_and_baud(line), sysid, deliver, channel)
