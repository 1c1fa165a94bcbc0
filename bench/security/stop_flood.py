"""Stops while others flood the bus: half-open connections, requests of a viewer, and a thief of requests."""

import asyncio
import socket
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from multiprocessing.queues import Queue
from pathlib import Path
from threading import Event

import numpy as np
import zenoh

from bench.security.lab import KeyedLab, elsewhere, participant
from formation.config import LinkConfig
from formation.messages import OperatorReply, OperatorRequest, Verb
from formation.requests import GCS_NAME
from formation.requests import LAB as LAB_NAME
from wire.clock import monotonic_ns, unix_us
from wire.process.system import raise_priority
from wire.schema import schema_of
from wire.security.bus_access import BusAccess, access_with
from wire.security.private_keys import KEY_BYTES
from wire.security.protection import protection_of
from wire.transport.stop_call import encode_stop
from wire.transport.stop_port import stop_ports
from wire.transport.zenoh_bus import ZenohBus
from wire.transport.zenoh_session import open_session, request_key

DUE_S, SETTLE_S, TURN_S = 0.5, 2.0, 0.005
BURST_MOST, FORGED_MOST = 20, 400
"""Requests of one turn: a machine that cannot send as many sends fewer, and goes on with the rest of the flood."""
STOPPED = "STOPPED by the true ground"


@dataclass(frozen=True, slots=True)
class Flood:
    """What comes beside the stops: connections that never greet, requests a second, whether a thief listens.

    datagrams_hz: at the port where a stop by one datagram arrives, those that no key has sealed.
    """

    half_open: int = 300
    requests_hz: float = 1000.0
    thief: bool = True
    datagrams_hz: float = 20_000.0


@dataclass(frozen=True, slots=True)
class Stops:
    """How many stops were asked for, answered by the true ground, and answered within DUE_S; and how fast."""

    asked: int
    answered: int
    in_time: int
    median_s: float
    worst_s: float
    requests_hz: float
    """Of the flood, as the ground has counted them."""


def stop_beside(flood: Flood, count: int, lab: KeyedLab, *, from_elsewhere: bool = False) -> Stops:
    """Run `gcs stop` so many times on the ground's computer, while the flood comes by the network's listener.

    from_elsewhere: on another computer, which has the network's listener alone.
    """
    file = elsewhere(lab, "tool") if from_elsewhere else lab.file
    with participant(_ground, lab) as counted, participant(_flood, lab, flood):
        Event().wait(SETTLE_S)
        received_before, begun_ns = _newest(counted), monotonic_ns()
        asked_s = [_stop(file) for _ in range(count)]
        requests_hz = (_newest(counted) - received_before) / ((monotonic_ns() - begun_ns) * 1e-9)
    answered_s = [each for each in asked_s if each is not None]
    in_time = sum(each <= DUE_S for each in answered_s)
    median_s, worst_s = np.percentile(answered_s or [inf], (50.0, 100.0))
    return Stops(count, len(answered_s), in_time, float(median_s), float(worst_s), requests_hz)


def _stop(lab_file: Path) -> float | None:
    """How long one command took, its start included, s; None where the true ground did not answer."""
    begun_ns = monotonic_ns()
    command = (sys.executable, "-m", "gcs", "stop", "--lab", str(lab_file))
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    return (monotonic_ns() - begun_ns) * 1e-9 if ended.stdout.strip() == STOPPED else None


def _newest(counted: "Queue[int]") -> int:
    """The newest count of the ground's, and nothing older left behind it."""
    newest: int = counted.get()
    while not counted.empty():
        newest = counted.get()
    return newest


def _ground(queue: "Queue[int]", lab: KeyedLab) -> None:
    """The true ground: answers, and says ten times a second how many statuses it was asked for."""

    async def serve() -> None:
        listening, asked = LinkConfig(zenoh_listen=(lab.listen,), zenoh_connect=()), 0
        bus = await ZenohBus.open(listening, LAB_NAME, protection=protection_of(lab.keys, "ground"))

        def answer(request: OperatorRequest, reply: Callable[[OperatorReply], None]) -> None:
            nonlocal asked
            asked += request.verb is Verb.STATUS
            reply(OperatorReply(request.id, True, STOPPED))

        bus.serve(GCS_NAME, answer)
        with stop_ports(listening, LAB_NAME, bus.protection, answer, bus.rejections, _ignore):
            while True:
                queue.put(asked)
                await asyncio.sleep(0.1)

    raise_priority()
    asyncio.run(serve())


class _Lawless(BusAccess):
    """Who has stolen keys of the lab and enforces no rule."""

    def configuration(self) -> dict[str, object]:
        """Without the access rules."""
        return {key: value for key, value in super().configuration().items() if key != "access_control"}


def _flood(queue: "Queue[str]", lab: KeyedLab, flood: Flood) -> None:
    """Everything hostile, until it is killed."""
    sessions: list[zenoh.Session] = []
    stolen: list[zenoh.Query] = []
    for _ in range(3 if flood.thief else 0):
        session = open_session((), (lab.from_network,), LAB_NAME, _Lawless(lab.keys / "page"))
        for key in (f"{LAB_NAME}/gcs/*/do/*", f"{LAB_NAME}/**", "**"):
            session.declare_queryable(key, zenoh.handlers.Callback(stolen.append), complete=True)
        sessions.append(session)
    access = access_with(lab.keys, "board")
    asking = open_session((), (lab.from_network,), LAB_NAME, access)
    key = request_key(LAB_NAME, GCS_NAME, access.name)
    payload = schema_of(OperatorRequest).encode(OperatorRequest(1, Verb.STATUS))
    idle: list[socket.socket] = []
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    forged = encode_stop("tool.1", bytes(KEY_BYTES), unix_us(), "nobody")
    queue.put("ready")
    asked, begun_ns, forged_count = 0, monotonic_ns(), 0
    while True:
        elapsed_s = (monotonic_ns() - begun_ns) * 1e-9
        for _ in range(min(round(elapsed_s * flood.datagrams_hz) - forged_count, FORGED_MOST)):
            stranger.sendto(forged, ("127.0.0.1", lab.port))
        forged_count = round(elapsed_s * flood.datagrams_hz)
        due = round(elapsed_s * flood.requests_hz)
        for _ in range(min(due - asked, BURST_MOST)):
            asking.get(key, _ignore, payload=payload, timeout=1.0)
        asked = due
        idle = [each for each in idle if _is_open(each)]
        idle += [_connection(lab.port) for _ in range(flood.half_open - len(idle))]
        Event().wait(TURN_S)


def _ignore(_reply: object) -> None:
    """An answer that nobody waits for."""


def _connection(port: int) -> socket.socket:
    """A connection that says nothing."""
    idle = socket.socket()
    idle.setblocking(False)
    idle.connect_ex(("127.0.0.1", port))
    return idle


def _is_open(idle: socket.socket) -> bool:
    """Whether the other end still waits; closed here where it does not."""
    try:
        if idle.recv(1):
            return True
    except BlockingIOError:
        return True
    except OSError:
        pass
    idle.close()
    return False
