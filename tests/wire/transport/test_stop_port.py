"""Stops by datagram over real sockets: one answer, obeyed once, beside forged ones, and none for who is revoked."""

import asyncio
import socket
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

import pytest

from formation.config import LinkConfig
from formation.messages import Event, Severity
from formation.requests import OperatorReply, OperatorRequest, Verb
from tests.free_ports import free_port
from tests.gcs.security.lab import keyed_lab
from wire import clock
from wire.rejections import RejectionLog
from wire.security.bus_access import LOCAL, BusAccess, access_with
from wire.security.protection import LOOPBACK_ONLY, protection_of
from wire.transport.stop_call import stop_by_datagram
from wire.transport.stop_port import stop_ports

Ask = Callable[[], OperatorReply | None]


def serve(
    folder: Path, ask: Callable[[str], Ask], answers: bool = True, *, keys: bool = True
) -> tuple[object, list[OperatorRequest], int]:
    """What `ask` got of a ground in the folder, what the ground was asked, and how many datagrams it rejected."""
    asked: list[OperatorRequest] = []
    rejections, protection = RejectionLog(), protection_of(folder / "keys", "ground") if keys else LOOPBACK_ONLY
    endpoint = f"tcp/127.0.0.1:{free_port()}"

    def handle(request: OperatorRequest, reply: Callable[[OperatorReply], None]) -> None:
        asked.append(request)
        if answers:
            reply(OperatorReply(1, True, "STOPPED"))

    async def run() -> object:
        link = LinkConfig(zenoh_connect=(endpoint,))
        with stop_ports(link, "lab", protection, handle, rejections, pytest.fail):
            return await asyncio.to_thread(ask(endpoint))

    return asyncio.run(run()), asked, rejections.count


def stop_of(access: BusAccess, wait_s: float = 10.0, lab: str = "lab") -> Callable[[str], Ask]:
    request = OperatorRequest(1, Verb.STOP, source="anna@tablet")
    return lambda endpoint: lambda: stop_by_datagram((endpoint,), lab, access, request, wait_s)


def test_a_stop_is_answered_and_its_asker_is_known(tmp_path: Path) -> None:
    keyed_lab(tmp_path)
    reply, asked, rejected = serve(tmp_path, stop_of(access_with(tmp_path / "keys", "board")))
    assert isinstance(reply, OperatorReply)
    assert (reply.accepted, reply.text) == (True, "STOPPED")
    assert [(each.verb, each.source) for each in asked] == [(Verb.STOP, "board.1 (anna@tablet at 127.0.0.1)")]
    assert rejected == 0


def test_a_stop_that_is_sent_again_and_again_is_asked_for_once(tmp_path: Path) -> None:
    keyed_lab(tmp_path)
    reply, asked, _ = serve(tmp_path, stop_of(access_with(tmp_path / "keys", "tool"), 0.3), answers=False)
    assert reply is None
    assert len(asked) == 1


def test_who_is_revoked_is_not_answered(tmp_path: Path) -> None:
    _, folder = keyed_lab(tmp_path)
    access = access_with(tmp_path / "keys", "anna")
    folder.revoke("anna", datetime.now(UTC))
    reply, asked, rejected = serve(tmp_path, stop_of(access, 0.2))
    assert reply is None
    assert asked == []
    assert rejected > 0


def test_a_rotated_key_counts_and_the_old_one_does_not(tmp_path: Path) -> None:
    _, folder = keyed_lab(tmp_path)
    old = (tmp_path / "keys" / "anna" / "stop.key").read_bytes()
    folder.rotate("anna", datetime.now(UTC))
    assert (tmp_path / "keys" / "anna" / "stop.key").read_bytes() != old
    assert [path.name for path in (tmp_path / "keys" / "ground").glob("stop-anna.*")] == ["stop-anna.2.key"]
    reply, asked, _ = serve(tmp_path, stop_of(access_with(tmp_path / "keys", "anna")))
    assert reply is not None
    assert asked[0].source.startswith("anna.2 (")


def test_a_lab_without_keys_is_stopped_by_datagram_and_no_other_lab_with_it(tmp_path: Path) -> None:
    reply, asked, _ = serve(tmp_path, stop_of(LOCAL), keys=False)
    assert isinstance(reply, OperatorReply)
    assert [(each.verb, each.source) for each in asked] == [(Verb.STOP, "anna@tablet")]
    reply, asked, rejected = serve(tmp_path, stop_of(LOCAL, 0.2, lab="lab2"), keys=False)
    assert (reply, asked) == (None, [])
    assert rejected > 0


def test_a_port_that_is_another_s_is_reported_and_the_ground_goes_on(tmp_path: Path) -> None:
    reported: list[Event] = []

    async def run(endpoint: str) -> None:
        link, log = LinkConfig(zenoh_connect=(endpoint,)), RejectionLog()
        with stop_ports(link, "lab", LOOPBACK_ONLY, lambda *_: None, log, reported.append):
            pass

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        asyncio.run(run(f"tcp/127.0.0.1:{other.getsockname()[1]}"))
    assert [event.severity for event in reported] == [Severity.WARNING]


def test_where_nobody_listens_it_ends_at_once(tmp_path: Path) -> None:
    keyed_lab(tmp_path)
    endpoint = f"tls/127.0.0.1:{free_port()}"
    begun_ns = clock.monotonic_ns()
    assert stop_of(access_with(tmp_path / "keys", "tool"), 600.0)(endpoint)() is None  # not after ten minutes
    assert stop_of(LOCAL, 600.0)(endpoint)() is None
    assert stop_of(LOCAL, 600.0)("tls/a-name.invalid:7447")() is None
    assert clock.monotonic_ns() - begun_ns < 60e9
