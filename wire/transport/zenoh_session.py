"""A session on the lab's bus, and one request over it: what an operator's command needs, and no more."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from threading import Event, Thread

import zenoh

from formation.requests import OperatorReply, OperatorRequest, Verb
from wire import clock
from wire.errors import BusError
from wire.process.port_holder import listener
from wire.process.system import CLOSING
from wire.schema import Schema, schema_of
from wire.security.bus_access import LOCAL, BusAccess, connectable

REQUEST: Schema[OperatorRequest] = schema_of(OperatorRequest)
REPLY: Schema[OperatorReply] = schema_of(OperatorReply)

# Zenoh's errors end in a line of its own source, which does not help an operator.
_SOURCE_LINE = re.compile(r" at \S+\.rs:\d+\.?")
FIND_S = 0.5
"""How long a ground is looked for that is not there: on a busy machine one answers within a tenth of a second."""
_REMEDY = "Start it with `gcs run lab.toml`; --lab and --name say which one is meant, --timeout to wait for it"
ASK_AGAIN_S = 0.05
RETRY = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}


@dataclass(frozen=True, slots=True)
class Patience:
    """How long one waits, s: for an answer; for a ground that does not show; for a bus at which nobody listens."""

    answer_s: float
    ground_s: float = FIND_S
    bus_s: float = FIND_S

    @classmethod
    def throughout(cls, wait_s: float) -> "Patience":
        """As long for everything: who says how long may wait for a ground that is about to start."""
        return cls(wait_s, wait_s, wait_s)


class NoGroundError(TimeoutError):
    """No ground is there; the text says what to do."""


def request_key(lab: str, gcs_name: str, certificate_name: str = "") -> str:
    """Where the ground `gcs_name` answers: with keys, each identity at a key of its own, which nobody else may ask at.

    certificate_name: who asks, or `*` for all; empty without keys.
    """
    key = f"{lab}/gcs/{gcs_name}/do"
    return f"{key}/{certificate_name}" if certificate_name else key


def open_session(
    listen: Sequence[str], connect: Sequence[str], lab: str, access: BusAccess = LOCAL, *, asks: bool = False
) -> zenoh.Session:
    """Join the bus; peers that are not there yet are retried for ever. BusError, ConfigError for keys.

    asks: this process only asks, and listens nowhere; a ground that listens everywhere it asks on this machine.
    """
    access.demand((*listen, *(map(connectable, connect) if asks else connect)))
    if "*" in lab or "$" in lab:
        raise BusError(f"lab {lab!r}: * and $ stand for other names on the bus")
    try:
        zenoh.KeyExpr(lab)
        return zenoh.open(_configuration(listen, connect, access, asks))
    except zenoh.ZError as error:
        reason = _SOURCE_LINE.sub("", str(error))
        if holder := listener(listen):
            reason = f"{holder} has the port ({reason})"
        raise BusError(f"lab {lab!r}, {tuple(listen or connect)}: {reason}") from error
    except OSError as error:
        raise BusError(f"lab {lab!r}: {error}") from error


def ask(
    connect: Sequence[str],
    lab: str,
    gcs_name: str,
    request: OperatorRequest,
    patience: Patience,
    access: BusAccess = LOCAL,
) -> OperatorReply:
    """The answer of the ground `gcs_name`; TimeoutError if none comes (NoGroundError: nobody is there), BusError.

    Asked again only while nobody is there to hear it, so no request is carried out twice; but a stop, which may be, is
    also asked again where the answer is late: somebody else may have taken the question and keeps it.
    """
    begun_ns = clock.monotonic_ns()
    deadline_ns = begun_ns + round(patience.answer_s * 1e9)
    key, payload = request_key(lab, gcs_name, access.name), REQUEST.encode(request)
    session, is_there = open_session((), connect, lab, access, asks=True), False
    answers: list[bytes] = []
    try:
        while (left_s := clock.REAL_TIME.seconds_until(deadline_ns)) > 0.0:
            ended = Event()

            def receive(reply: zenoh.Reply, ended: Event = ended) -> None:
                if reply.ok is not None:
                    answers.append(reply.ok.payload.to_bytes())
                    ended.set()

            session.get(key, zenoh.handlers.Callback(receive, ended.set), payload=payload, timeout=left_s)
            wait_s = min(left_s, 0.2) if request.verb is Verb.STOP else left_s
            is_there = not ended.wait(wait_s)  # else the query has ended at once: nobody serves the key
            if answers:
                return REPLY.decode(answers[0])
            if not is_there and _is_out_of_patience((clock.monotonic_ns() - begun_ns) * 1e-9, connect, patience):
                break
            if not is_there:
                Event().wait(ASK_AGAIN_S)
        if not is_there:
            raise _no_ground(key, connect)
    finally:
        _close(session)
    raise TimeoutError(f"no answer on {key} within {patience.answer_s:g} s")


def _close(session: zenoh.Session) -> None:
    """Close, but wait no longer than 0.1 s: Zenoh waits 10 s for a connection that it is opening."""
    closing = Thread(target=session.close, name=CLOSING, daemon=True)
    closing.start()
    closing.join(0.1)


def _is_out_of_patience(waited_s: float, connect: Sequence[str], patience: Patience) -> bool:
    """Whether a ground that has not appeared for `waited_s` is given up."""
    return waited_s > patience.ground_s or (waited_s > patience.bus_s and _is_silent(connect))


def _is_silent(connect: Sequence[str]) -> bool:
    """Whether nobody listens at the bus: the machine of every endpoint refuses the connection."""
    return bool(connect) and all(_is_port_closed(endpoint) for endpoint in connect)


def _no_ground(key: str, connect: Sequence[str]) -> NoGroundError:
    found = f"nobody listens at {', '.join(connect)}" if _is_silent(connect) else f"on the bus nobody serves {key}"
    return NoGroundError(f"{found}. {_REMEDY}")


def _is_port_closed(endpoint: str) -> bool:
    """Whether the machine refuses a connection there."""
    import socket  # an emergency stop that finds its ground does without

    protocol, _, address = endpoint.partition("/")
    host, _, port = address.rpartition(":")
    if protocol not in ("tcp", "tls") or not port.isdigit():
        return False
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=0.2).close()
    except ConnectionRefusedError:
        return True
    except OSError:
        return False
    return False


def _configuration(listen: Sequence[str], connect: Sequence[str], access: BusAccess, asks: bool) -> zenoh.Config:
    """Zenoh's configuration; without `listen`, any free port of the address that leads to `connect`.

    Who only asks listens nowhere: others would look for it where it was, for as long as they live.
    """
    listens = [*access.carried(listen), *access.open_loopback(listen)]
    if not listens and not asks:
        listens = [access.own_endpoint(connect)]
    connects = [*([] if listen else access.loopback()), *access.carried([connectable(e) for e in connect])]
    values: dict[str, object] = {
        "mode": "peer",
        "listen/endpoints": listens,
        "listen/exit_on_failure": True,
        "connect/endpoints": [endpoint for endpoint in connects if endpoint not in listens],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": RETRY,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": True,
        # How long opening waits, ms, for peers and what they declare; a notice may be lost in it. Who only asks, asks
        # again instead.
        "scouting/delay": 50 if asks else 500,
        "transport/shared_memory/enabled": False,
        # Connections that have said nothing yet, and how long each is waited for, ms. Zenoh's own are 100 for 10 s: as
        # many idle ones kept an operator's new command out for 10.6 s.
        "transport/unicast/accept_pending": 1024,
        "transport/unicast/accept_timeout": 2000,
        # Batches that may wait for the sender's thread, as many as Zenoh allows. An express put takes one for itself:
        # with Zenoh's own two, a busy machine dropped one frame in twenty, and one in nine events right after a frame.
        "transport/link/tx/queue/size/real_time": 16,
        **access.configuration(),
    }
    return zenoh_config(values)


def zenoh_config(values: Mapping[str, object]) -> zenoh.Config:
    """Zenoh's configuration with these values, by the paths of their keys."""
    result = zenoh.Config()
    for key, value in values.items():
        result.insert_json5(key, json.dumps(value))
    return result
