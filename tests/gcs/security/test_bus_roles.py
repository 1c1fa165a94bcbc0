"""Who may do what on the bus with keys: real Zenoh sessions on loopback, Zenoh's own access control as it is made."""

from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event

import pytest
import zenoh

from formation.messages import OperatorReply, OperatorRequest, Verb
from formation.requests import LAB as LAB_NAME
from tests.free_ports import free_port
from tests.gcs.security.lab import keyed_lab
from wire.clock import monotonic_ns
from wire.schema import schema_of
from wire.security.bus_access import BusAccess, access_with
from wire.transport.zenoh_session import Patience, ask, open_session

KEYS = (
    "mocap/frame/mocap.1", "mocap/raw/tool.1", "mocap/event/mocap.1", "mocap/state/mocap.1", "mocap/frame",
    "uav/1/mavlink/down", "uav/1/mavlink/up", "uav/2/mavlink/down", "uav/2/mavlink/up", "sim/1/truth/drone-1.1",
    "gcs/main/state/ground.1", "gcs/main/do/tool.1", "gcs/main/log/head/ground.1", "gcs/main/log/chunk/ground.1",
    "gcs/main/state/mocap.1", "uav/*/mavlink/down", "uav/*/mavlink/up", "mocap/*", "**", "gcs/main/*",
)  # fmt: skip
MAY_PUBLISH = {
    "ground": {
        "uav/1/mavlink/down", "uav/2/mavlink/down", "uav/*/mavlink/down", "gcs/main/state/ground.1",
        "gcs/main/log/head/ground.1", "gcs/main/log/chunk/ground.1",
    },
    "mocap": {"mocap/frame/mocap.1", "mocap/event/mocap.1", "mocap/state/mocap.1"},
    "page": set(),
    "tool": {"mocap/raw/tool.1"},
    "drone-1": {"uav/1/mavlink/up", "sim/1/truth/drone-1.1"},
    "drone-2": {"uav/2/mavlink/up"},
    "board": set(),
}  # fmt: skip
"""By hand, from the manual: whoever may not is not heard."""
TIMES = 75
SETTLE_S = 20.0


def wait_for(condition: object) -> None:
    """Wait until the condition holds, or the test's patience ends."""
    pause, end_ns = Event(), monotonic_ns() + round(SETTLE_S * 1e9)
    while not condition() and monotonic_ns() < end_ns:  # type: ignore[operator]
        pause.wait(0.05)


@contextmanager
def bus(folder: Path, names: tuple[str, ...]) -> Iterator[tuple[str, dict[str, zenoh.Session]]]:
    """The sessions of these identities, the first as the hub, all connected to it."""
    keyed_lab(folder)
    endpoint = f"tls/127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        sessions = {}
        for k, name in enumerate(names):
            listen, connect = ((endpoint,), ()) if k == 0 else ((), (endpoint,))
            session = open_session(listen, connect, LAB_NAME, access_with(folder / "keys", name))
            sessions[name] = stack.enter_context(session)
        wait_for(lambda: all(len(s.info.peers_zid()) == len(names) - 1 for s in sessions.values()))
        yield endpoint, sessions


def test_each_identity_publishes_its_own_and_nothing_else(tmp_path: Path) -> None:
    """7 identities on 20 keys and wildcards, 75 times each: 10,500 publications."""
    names = ("judge", *MAY_PUBLISH)
    with bus(tmp_path, names) as (_, sessions):
        heard: Counter[tuple[str, str]] = Counter()

        def receive(sample: zenoh.Sample) -> None:
            heard[sample.payload.to_string(), str(sample.key_expr).removeprefix("lab/")] += 1

        subscriber = sessions["judge"].declare_subscriber("lab/**", zenoh.handlers.Callback(receive))
        ready = Event()
        ready.wait(1.0)  # for the subscription to be known to every session
        for name in MAY_PUBLISH:
            for key in KEYS:
                publisher = sessions[name].declare_publisher(
                    f"lab/{key}", congestion_control=zenoh.CongestionControl.BLOCK
                )
                for _ in range(TIMES):
                    publisher.put(name)
        expected = {(name, key): TIMES for name, keys in MAY_PUBLISH.items() for key in keys}
        wait_for(lambda: dict(heard) == expected)
        ready.wait(0.5)  # what is forbidden would come now
        assert dict(heard) == expected
        subscriber.undeclare()


class _Unruled(BusAccess):
    """Who has keys of the lab and enforces no rule: an attacker on a computer of the lab."""

    def configuration(self) -> dict[str, object]:
        return {key: value for key, value in super().configuration().items() if key != "access_control"}


@pytest.mark.parametrize(("thief", "keeps"), [("page", True), ("mocap", False), ("drone-1", True)])
def test_a_stop_reaches_the_ground_beside_a_thief(thief: str, keeps: bool, tmp_path: Path) -> None:
    """Three sessions of a stolen key declare that they answer: every new `gcs stop` is answered by the true ground."""
    with bus(tmp_path, ("ground",)) as (endpoint, sessions), ExitStack() as stack:
        obeyed, kept = [], []

        def obey(query: zenoh.Query) -> None:
            obeyed.append(str(query.key_expr))
            reply_to(query, "STOPPED")

        def steal(query: zenoh.Query) -> None:
            kept.append(query)
            if not keeps:
                reply_to(query, "stolen")

        sessions["ground"].declare_queryable("lab/gcs/main/do/*", zenoh.handlers.Callback(obey))
        for _ in range(3):
            session = stack.enter_context(open_session((), (endpoint,), "lab", _Unruled(tmp_path / "keys" / thief)))
            for key in ("lab/gcs/main/do/*", "lab/**", "**"):
                session.declare_queryable(key, zenoh.handlers.Callback(steal), complete=True)
        wait_for(lambda: len(sessions["ground"].info.peers_zid()) == 3)
        access = access_with(tmp_path / "keys", "tool")
        for k in range(10):
            stop = OperatorRequest(k, Verb.STOP)
            reply = ask((endpoint,), "lab", "main", stop, Patience.throughout(SETTLE_S), access)
            assert (reply.id, reply.text) == (k, "STOPPED")
        assert set(obeyed) == {"lab/gcs/main/do/tool.1"}


def reply_to(query: zenoh.Query, text: str) -> None:
    """Answer a request in a ground's words."""
    request = schema_of(OperatorRequest).decode(query.payload.to_bytes() if query.payload is not None else b"")
    query.reply(query.key_expr, schema_of(OperatorReply).encode(OperatorReply(request.id, True, text)))
    query.drop()


def test_nobody_asks_in_anothers_name(tmp_path: Path) -> None:
    with bus(tmp_path, ("ground", "tool", "board", "mocap", "drone-1")) as (_, sessions):
        asked = []

        def answer(query: zenoh.Query) -> None:
            asked.append(str(query.key_expr))
            query.reply(query.key_expr, b"yes")
            query.drop()

        sessions["ground"].declare_queryable("lab/gcs/main/do/*", zenoh.handlers.Callback(answer))
        own = {"tool": "tool.1", "board": "board.1"}
        for name, key in own.items():
            wait_for(lambda name=name, key=key: _answers(sessions[name], f"lab/gcs/main/do/{key}"))
        asked.clear()
        for name in ("tool", "board", "mocap", "drone-1"):
            others = {"tool.1", "board.1", "page.1", "anna.1", "drone-1.1", "*", "t$*"} - {own.get(name)}
            for key in sorted(others):
                assert _answers(sessions[name], f"lab/gcs/main/do/{key}") == []
            assert _answers(sessions[name], "lab/gcs/**") == []
        assert asked == []


def _answers(session: zenoh.Session, selector: str) -> list[bytes]:
    return [r.ok.payload.to_bytes() for r in session.get(selector, timeout=0.3) if r.ok is not None]


def test_who_has_no_certificate_of_the_lab_is_not_on_the_bus(tmp_path: Path) -> None:
    with bus(tmp_path / "ours", ("ground", "mocap")) as (endpoint, sessions):
        heard = []
        sessions["mocap"].declare_subscriber("lab/**", zenoh.handlers.Callback(heard.append))
        keyed_lab(tmp_path / "theirs")
        plain = endpoint.replace("tls", "tcp")
        strangers = (
            open_session((), (endpoint,), "lab", access_with(tmp_path / "theirs" / "keys", "ground")),
            open_session((), (plain,), "lab", BusAccess()),
        )
        for stranger in strangers:
            stranger.put("lab/uav/1/mavlink/down", b"disarm")
            Event().wait(1.5)
            stranger.put("lab/uav/1/mavlink/down", b"disarm")
            assert not list(stranger.info.peers_zid())
            stranger.close()
        assert heard == []
        sessions["ground"].put("lab/uav/1/mavlink/down", b"hold")
        wait_for(lambda: heard)
        assert [sample.payload.to_bytes() for sample in heard] == [b"hold"]  # the bus itself works


def test_only_a_ground_is_known_as_one_and_only_mocap_as_mocap(tmp_path: Path) -> None:
    """A token of "another ground" would keep every drone from arming."""
    names = ("judge", "ground", "mocap", "page", "tool", "drone-1", "board")
    with bus(tmp_path, names) as (_, sessions):
        seen, pause = set(), Event()

        def receive(sample: zenoh.Sample) -> None:
            seen.add(str(sample.key_expr))

        watching = sessions["judge"].liveliness().declare_subscriber("lab/**", zenoh.handlers.Callback(receive))
        pause.wait(1.0)
        tokens = [
            sessions[name].liveliness().declare_token(f"lab/{kind}/{name}")
            for name in names[1:]
            for kind in ("ground/main", "mocap/alive", "gcs/main")
        ]
        allowed = {"lab/ground/main/ground", "lab/mocap/alive/mocap"}
        wait_for(lambda: seen >= allowed)
        pause.wait(0.5)
        assert seen == allowed
        for token in tokens:
            token.undeclare()
        watching.undeclare()
