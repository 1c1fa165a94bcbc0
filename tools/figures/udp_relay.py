"""Stands between ground and drones over UDP and loses, delays, reorders and repeats their datagrams, by a seed."""

import asyncio
import socket
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from formation.config import LinkConfig
from formation.messages import Datagram
from sim.faults.channel import Channel
from sim.faults.fault import Fault
from wire.clock import Clock
from wire.transport.memory_bus import NOTHING_DUE_NS, fixed_delay

LARGEST = 4096


class _Way:
    """One direction of one drone's link: from a socket, through the faults, to a port."""

    def __init__(self, reads: socket.socket, sends: socket.socket, to: tuple[str, int], channel: Channel) -> None:
        self.reads, self._sends, self._to, self.channel = reads, sends, to, channel
        self.faults: Sequence[Fault] = ()

    def take(self, now_ns: int) -> None:
        while True:
            try:
                data = self.reads.recv(LARGEST)
            except BlockingIOError:
                return
            except OSError:  # an ICMP answer to something sent earlier
                continue
            self.channel.push(now_ns, Datagram(0, data), [(fault, 0) for fault in self.faults])

    def give(self, now_ns: int) -> None:
        for sent in self.channel.pop_due(now_ns):
            try:
                self._sends.sendto(sent.datagram.data, self._to)
            except OSError:  # nobody there, or no room: lost, as on a wire
                continue


class Relay:
    """Both directions of every drone's link; `down`, `up`: the faults each way, which may be changed as it runs."""

    def __init__(self, ways: dict[str, list[_Way]], clock: Clock) -> None:
        self._ways, self._clock = ways, clock
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        for way in self._all():
            self._loop.add_reader(way.reads, self._turn, way)

    def meet(self, down: Sequence[Fault], up: Sequence[Fault]) -> None:
        """From now on these."""
        for name, faults in (("down", down), ("up", up)):
            for way in self._ways[name]:
                way.faults = faults

    def close(self) -> None:
        """Relay nothing any more."""
        if self._timer is not None:
            self._timer.cancel()
        for way in self._all():
            self._loop.remove_reader(way.reads)

    def _all(self) -> list[_Way]:
        return [way for ways in self._ways.values() for way in ways]

    def _turn(self, read: _Way | None = None) -> None:
        now_ns = self._clock.monotonic_ns()
        if read is not None:
            read.take(now_ns)
        for way in self._all():
            way.give(now_ns)
        due_ns = min(way.channel.next_due_ns for way in self._all())
        if self._timer is not None:
            self._timer.cancel()
        if due_ns < NOTHING_DUE_NS:
            self._timer = self._loop.call_later(self._clock.seconds_until(due_ns), self._turn)


@contextmanager
def relay(lab: LinkConfig, drones: LinkConfig, sysids: Sequence[int], seed: int, clock: Clock) -> Iterator[Relay]:
    """Between the ground of `lab` and drones that have `drones` as their link. OSError where a port is taken.

    The ground hears a drone from the port that it sends to, and so does the drone.
    """
    sockets: list[socket.socket] = []

    def bound(port: int) -> socket.socket:
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sockets.append(opened)
        opened.setblocking(False)
        opened.bind((lab.host, port))
        return opened

    ways: dict[str, list[_Way]] = {"down": [], "up": []}
    try:
        for sysid in sysids:
            as_drone, as_ground = bound(lab.drone_port_base + sysid), bound(drones.ground_port_base + sysid)
            luck = (Channel(fixed_delay(0.0), np.random.default_rng([seed, sysid, way])) for way in range(2))
            ways["down"].append(_Way(as_drone, as_ground, (lab.host, drones.drone_port_base + sysid), next(luck)))
            ways["up"].append(_Way(as_ground, as_drone, (lab.host, lab.ground_port_base + sysid), next(luck)))
        running = Relay(ways, clock)
        try:
            yield running
        finally:
            running.close()
    finally:
        for opened in sockets:
            opened.close()
