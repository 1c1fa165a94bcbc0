"""CRTP by cflib's drivers, over a Crazyradio or UDP: their calls block, so a link has two threads. Needs `[crazyflie]`.

cflib reports a Crazyflie that does not answer. Of a radio that is unplugged it reports nothing and may wait for ever:
the silence shows that. Of packets that wait for the radio's turn the newest of a kind is sent. Several links of one
radio share it in cflib, in turn, a packet each.
"""

import asyncio
from collections.abc import Callable
from threading import Condition, Thread

from cflib.crtp.crtpstack import CRTPPacket
from cflib.crtp.radiodriver import RadioDriver, RadioManager
from cflib.crtp.udpdriver import UdpDriver

from wire.crtp import Port, port_and_channel

_POLL_S, _JOIN_S = 0.1, 1.0
_SILENT_POLLS = 20
"""Of 2 s: by then cflib has reported a Crazyflie that does not answer a hundred packets."""
_DRIVERS = {"radio": RadioDriver, "udp": UdpDriver}


class CrtpLink:
    """One Crazyflie's link; open it with `open_crtp`."""

    def __init__(self, driver: RadioDriver | UdpDriver, deliver: Callable[[bytes], None]) -> None:
        """deliver: called on the event loop with each packet."""
        self.lost = asyncio.Event()
        self.why = ""
        """Why it was lost."""
        self.has_received = self.radio_is_lost = False
        """Whether a packet came; whether not the Crazyflie is lost, but its radio, and so every link of it."""
        self.quality = float("nan")
        """Of a radio: percent of packets that needed no second try; NaN where nobody measures it."""
        self._driver, self._deliver = driver, deliver
        self._loop = asyncio.get_running_loop()
        self._outbox: dict[bytes, bytes] = {}
        self._changed = Condition()
        self._closed = False
        self._threads = [Thread(target=target, daemon=True) for target in (self._receive, self._send)]

    def connect(self, uri: str) -> None:
        """Open the driver; blocks, raises what cflib raises, which is an Exception."""
        self._radio = RadioDriver.parse_uri(uri)[0] if isinstance(self._driver, RadioDriver) else None
        self._driver.connect(uri, self._measure, self._lose)
        for thread in self._threads:
            thread.start()

    def send(self, data: bytes) -> None:
        """Hand a packet over; never waits."""
        # Setpoints are one kind; elsewhere the first byte of the payload says which.
        kind = data[:1] if port_and_channel(data)[0] == Port.COMMANDER else data[:2]
        with self._changed:
            self._outbox.pop(kind, None)
            self._outbox[kind] = data
            self._changed.notify()

    def close(self) -> None:
        """Stop; blocks for a moment."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        for thread in self._threads:
            thread.join(_JOIN_S)
        closer = Thread(
            target=self._driver.close, daemon=True
        )  # cflib's waits for a radio's answer, which may not come
        closer.start()
        closer.join(_JOIN_S)

    def _receive(self) -> None:
        silent = 0
        while not self._closed:
            packet = self._driver.receive_packet(_POLL_S)
            silent = silent + 1 if packet is None else 0
            if silent == _SILENT_POLLS:
                self.radio_is_lost = self._radio is not None and not self.lost.is_set()
                if self.radio_is_lost:
                    RadioManager.remove(self._radio)  # the next link opens it anew
                self._lose("no packet for 2 s")
            if packet is not None and not self._closed:
                self.has_received = True
                self._loop.call_soon_threadsafe(self._deliver, bytes((packet.header, *packet.data)))

    def _send(self) -> None:
        while True:
            with self._changed:
                while not self._outbox and not self._closed:
                    self._changed.wait()
                if self._closed:
                    return
                data = self._outbox.pop(next(iter(self._outbox)))
            self._driver.send_packet(CRTPPacket(data[0], data[1:]))

    def _measure(self, statistics: dict[str, float]) -> None:
        self.quality = statistics.get("link_quality", self.quality)

    def _lose(self, why: str) -> None:
        if not self._closed and not self.why:
            self.why = why.strip().partition("\n")[0]
            self._loop.call_soon_threadsafe(self.lost.set)


async def open_crtp(uri: str, deliver: Callable[[bytes], None]) -> CrtpLink:
    """The link to an address that `wire.crtp.is_address`; OSError where its radio cannot be had."""
    link = CrtpLink(_DRIVERS[uri.partition("://")[0]](), deliver)
    try:
        await asyncio.to_thread(link.connect, uri)
    except Exception as error:
        raise OSError(f"{uri}: {error}") from error
    return link
