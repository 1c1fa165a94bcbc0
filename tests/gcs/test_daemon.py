"""The daemon in this process: a recorded leader as its mocap, a bus of its own, no drone that answers."""

import asyncio
import os
import signal
import socket
from itertools import pairwise
from pathlib import Path
from typing import cast

import numpy as np
import pytest

import gcs.daemon
from formation import topics
from formation.config import LabConfig, LinkConfig
from formation.messages import Event, LabFrame, OperatorReply, OperatorRequest, Phase, Verb
from gcs.core import BrokenInvariantError, GcsCore, Outgoing
from gcs.daemon import BORROWED, Ground, GroundFailure, RunResult, Timing, know_other_grounds, run
from gcs.replay import replay
from tests.free_ports import free_port
from tests.gcs.bus import a_lab, hub_of
from tests.wire.flight import check_log
from wire.clock import REAL_TIME, Clock
from wire.config_file import dump
from wire.ground_state import LogFile
from wire.logs.mcap_read import read_log
from wire.logs.mcap_write import LogWriter
from wire.rejections import RejectionLog
from wire.transport.link import Link
from wire.transport.zenoh_bus import ZenohBus

FRAMES = 400


def _lab(tmp_path: Path, frames: int = FRAMES) -> LabConfig:
    """A recording of two seconds."""
    csv, step_ns = tmp_path / "leader.csv", 2_000_000_000 // frames
    csv.write_text("".join(f"{i * step_ns},{0.4 * i / frames},0,1,1,0,0,0\n" for i in range(frames)))
    return LabConfig.model_validate(
        {
            "name": f"test-{os.getpid()}",
            "mocap": {"source": "csv", "file": str(csv), "rate_hz": 0.5 * frames, "delay_s": 0.0},
            "leader": {"body": "lead"},
            "followers": [{"body": "left", "sysid": 2, "offset_m": (0, 1, 0)}],
            "link": {"zenoh_listen": (f"tcp/127.0.0.1:{free_port()}",), "zenoh_connect": ()},
        }
    )


def _lab_file(config: LabConfig, folder: Path) -> Path:
    file = folder / "lab.toml"
    file.write_text(dump(config))
    return file


async def _until_over(config: LabConfig, folder: Path, events: list[Event]) -> RunResult:
    """The daemon and its mocap process, asked to end when the recording is over."""

    def tell(event: Event) -> None:
        events.append(event)
        if event.text == "the recording is over":
            os.kill(os.getpid(), signal.SIGINT)

    return await run(config, _lab_file(config, folder), folder / "flight.mcap", "main", {"scenario": "test"}, tell)


def test_frames_are_flown_recorded_with_their_latency_and_replayed_bit_by_bit(tmp_path, monkeypatch):
    monkeypatch.setattr(LogWriter, "trouble", lambda _log, _now_ns: "the disk is full")
    events: list[Event] = []
    ended = asyncio.run(_until_over(_lab(tmp_path), tmp_path, events))
    log = tmp_path / "flight.mcap"
    assert any("no mocap process serves" in event.text for event in events)
    assert [event.text for event in events if event.source == "log"] == ["the disk is full"]
    assert (ended.phase, ended.lost_records) == (Phase.GROUND, 0)
    held, flown = check_log(log), read_log(log)
    assert held.complete
    assert 20 <= held.entries["mocap/frame"] <= FRAMES
    assert held.entries["mocap/frame"] == ended.timing.ticks
    assert 0 < held.entries["control/target"] < ended.timing.ticks  # on the ground ten a second are kept
    assert flown.metadata["scenario"] == "test"
    assert int(flown.metadata["ground_session"]) > 1_700_000_000
    assert replay(flown).identical
    entries = list(read_log(log).entries)
    timings = [e.message for e in entries if e.topic is topics.TIMING]
    captured_ns = {e.message.t_capture_ns: e.message.seq for e in entries if e.topic is topics.MOCAP}
    controlled = [captured_ns[e.message.t_ns] for e in entries if e.topic is topics.TARGET]
    assert [timing.frame_seq for timing in timings if not timing.late or timing.frame_seq in controlled] == controlled
    assert all(0.0 < timing.latency_s < 1.0 for timing in timings)


class _Core:
    """A core in flight for which something is due every millisecond: an answer, or at 15 ms a frame that is overdue."""

    phase, watchdog_ns = Phase.HOLD, 15_000_000

    def __init__(self) -> None:
        self.ticks_ns = [0]

    def next_deadline_ns(self) -> int:
        return self.ticks_ns[-1] + 1_000_000

    def receive(self, message: object, now_ns: int) -> None:
        pass

    def tick(self, now_ns: int) -> Outgoing:
        self.ticks_ns.append(now_ns)
        return Outgoing((), (), ())


class _Clock:
    """Time that passes by sleeping alone, until it ends."""

    now_ns, end_ns = 0, 0

    def monotonic_ns(self) -> int:
        return self.now_ns

    async def sleep_until_ns(self, deadline_ns: int, interrupt: asyncio.Event | None = None) -> None:
        if deadline_ns > self.end_ns:
            raise asyncio.CancelledError
        self.now_ns = max(self.now_ns, deadline_ns)


def _frame(seq: int) -> LabFrame:
    return LabFrame(seq, seq, ("lead", "left"), np.zeros((2, 3)), np.eye(4)[[0, 0]], np.ones(2, np.bool_))


@pytest.mark.parametrize(("until_ms", "late"), [(14, 0), (15, 1), (17, 3)])
def test_a_tick_is_late_for_an_overdue_frame_and_not_for_an_answer(until_ms: int, late: int, tmp_path: Path) -> None:
    async def watched() -> Timing:
        core, clock = _Core(), _Clock()
        with LogWriter(tmp_path / "flight.mcap", {}, threaded=False) as log:
            ground = Ground(_lab(tmp_path), cast(GcsCore, core), log, lambda _event: None, cast(Clock, clock))
            ground.receive_frame(_frame(0))
            clock.end_ns = until_ms * 1_000_000
            with pytest.raises(asyncio.CancelledError):
                await ground.watch()
            assert len(core.ticks_ns) == until_ms + 2
            return ground.timing

    timing = asyncio.run(watched())
    assert (timing.ticks, timing.late) == (1 + late, late)


def test_an_earlier_deadline_wakes_the_daemon(tmp_path: Path) -> None:
    """A motor cut that begins while the daemon sleeps is repeated after 10 ms, not when the next frame is overdue."""
    core, hour_ns = _Core(), 3_600_000_000_000
    core.next_deadline_ns = lambda: core.ticks_ns[-1] + (hour_ns if len(core.ticks_ns) == 1 else 1_000_000)  # type: ignore[method-assign]

    async def watched() -> None:
        with LogWriter(tmp_path / "flight.mcap", {}, threaded=False) as log:
            ground = Ground(_lab(tmp_path), cast(GcsCore, core), log, lambda _event: None, REAL_TIME)
            core.ticks_ns[0] = REAL_TIME.monotonic_ns()
            watching = asyncio.create_task(ground.watch())
            await asyncio.sleep(0)
            ground.receive_request(OperatorRequest(1, Verb.STOP), lambda _reply: None)
            async with asyncio.timeout(30.0):
                while len(core.ticks_ns) < 4:
                    await asyncio.sleep(0.001)
            watching.cancel()

    asyncio.run(watched())


def test_a_spares_link_is_opened_once_and_one_that_cannot_be_is_the_answer(tmp_path: Path) -> None:
    """Taken for good where the core then refuses: nobody beats behind it here."""
    opened: list[int] = []

    async def open_link(sysid: int) -> Link:
        opened.append(sysid)
        if sysid == 8:
            raise OSError("UDP ports 14548 on 127.0.0.1: taken")
        return cast(Link, object())

    async def asked(ground: Ground, argument: str) -> OperatorReply:
        answered = asyncio.get_running_loop().create_future()
        ground.receive_request(OperatorRequest(5, Verb.REPLACE, argument), answered.set_result)
        for _ in range(100):
            await asyncio.sleep(0)
            ground._tick(ground._clock.monotonic_ns() + 4_000_000_000)
            if answered.done():
                break
        return cast(OperatorReply, answered.result())

    async def replies() -> list[OperatorReply]:
        with LogWriter(tmp_path / "flight.mcap", {}, threaded=False) as log:
            config = _lab(tmp_path)
            core = GcsCore(config, REAL_TIME.monotonic_ns())
            ground = Ground(config, core, log, lambda _event: None, REAL_TIME)
            ground.open_link = open_link
            return [await asked(ground, argument) for argument in ("8 left", "7 left", "7 left", "7 middle", "left")]

    texts = [reply.text for reply in asyncio.run(replies())]
    assert texts[0] == "UDP ports 14548 on 127.0.0.1: taken"
    assert [text.startswith("nothing is heard of system 7") for text in texts[1:3]] == [True, True]
    assert texts[3] == "middle: none of the lab's drones (left)"
    assert opened == [8, 7]


def test_what_fails_beside_the_core_is_reported_and_ends_no_flight(tmp_path, monkeypatch):
    """A library's forgotten task, a callback of the bus, the free disk space: each ended the ground."""

    def fails(*_: object) -> LogFile:
        raise ZeroDivisionError("of the disk")

    monkeypatch.setattr(gcs.daemon, "_measured", fails)
    events: list[Event] = []

    async def flown() -> RunResult:
        loop = asyncio.get_running_loop()

        def fail_in_callback() -> None:
            raise RuntimeError("of a library")

        def throw() -> None:
            loop.call_exception_handler({"message": "Task exception was never retrieved", "exception": OSError("lost")})
            loop.call_soon(fail_in_callback)

        throwing = loop.call_later(0.2, throw)
        try:
            return await _until_over(_lab(tmp_path), tmp_path, events)
        finally:
            throwing.cancel()

    assert asyncio.run(flown()).phase is Phase.GROUND
    said = " ".join(event.text for event in events if event.source == "event loop")
    for reason in ("watch_disk has ended: ZeroDivisionError", "retrieved: OSError: lost", "RuntimeError: of a library"):
        assert reason in said


class _Bus:
    """A bus on which nothing arrives; what is published on it is counted."""

    rejections = RejectionLog()
    published = 0

    def publish_state(self, name: str, text: str) -> None:
        self.published += 1


def test_the_state_is_published_after_a_tick_and_delays_none(tmp_path: Path) -> None:
    """A state of 100 drones takes as long as a tick: made when a frame comes, it would delay that frame's setpoints."""

    async def published() -> list[int]:
        clock, bus, counts = _Clock(), _Bus(), []
        clock.end_ns = 10**12
        with LogWriter(tmp_path / "flight.mcap", {}, threaded=False) as log:
            lab = _lab(tmp_path)
            ground = Ground(lab, GcsCore(lab, 0), log, lambda _event: None, cast(Clock, clock))
            publishing = asyncio.create_task(ground.publish_state(cast(ZenohBus, bus), "main"))
            for seq in range(3):
                await asyncio.sleep(0)
                await asyncio.sleep(0)
                counts.append(bus.published)
                ground.receive_frame(_frame(seq))
                counts.append(bus.published)
            publishing.cancel()
        return counts

    assert asyncio.run(published()) == [1, 1, 2, 2, 3, 3]


def test_a_core_that_breaks_ends_the_daemon_with_its_reason_and_a_whole_log(tmp_path, monkeypatch):
    whole_tick, log = GcsCore.tick, tmp_path / "flight.mcap"

    def tick(core: GcsCore, now_ns: int):
        outgoing = whole_tick(core, now_ns)
        if core._lateness.frames > 20:
            raise BrokenInvariantError("the estimate is not finite")
        return outgoing

    monkeypatch.setattr(GcsCore, "tick", tick)
    config = _lab(tmp_path)
    with pytest.raises(GroundFailure, match="BrokenInvariantError: the estimate is not finite"):
        asyncio.run(run(config, _lab_file(config, tmp_path), log, "main", {}, lambda _event: None))
    assert check_log(log).complete


def test_a_bus_of_another_labs_ground_is_named_with_the_way_to_ones_own(tmp_path):
    """Two labs on one machine, neither of which says where its bus is: the second one's ends with the first's."""
    endpoint, events = f"tcp/127.0.0.1:{free_port()}", list[Event]()
    link = LinkConfig.model_construct(_fields_set=set(), zenoh_connect=(endpoint,))
    config = _lab(tmp_path).model_copy(update={"link": link})

    async def run_second() -> None:
        first = await ZenohBus.open(LinkConfig(zenoh_listen=(endpoint,)), "another")
        try:
            await _until_over(config, tmp_path, events)
        finally:
            await first.close()

    asyncio.run(run_second())
    assert BORROWED in events


def test_a_port_that_is_taken_is_named(tmp_path):
    config = _lab(tmp_path)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        link = config.link.model_copy(update={"kind": "udp", "ground_port_base": port - 2})
        config = config.model_copy(update={"link": link})
        with pytest.raises(
            OSError, match=f"UDP ports {port} on 127.0.0.1: Address already in use: .*process {os.getpid()}"
        ):
            asyncio.run(_until_over(config, tmp_path, []))


STRAYS = (b"\xfe" * 1500, b"\xfd" * 1500, bytes(60_000), b"no MAVLink", b"\xfd\xff\x02" * 500)


async def _stray(port: int) -> None:
    """Throw strays at the port, each kind in turn; for ever."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        while True:
            for stray in STRAYS:
                stranger.sendto(stray, ("127.0.0.1", port))
            await asyncio.sleep(0.0025)


def test_strays_cost_no_frame_are_not_recorded_and_are_reported_once_a_second(tmp_path):
    """640 a second cost six of ten frames: each was searched byte by byte, and logged."""
    # A frame every 20 ms: what else the machine does costs few of them, a stray searched byte by byte as many as ever.
    plain = _lab(tmp_path, frames=100)
    link = {"kind": "udp", "ground_port_base": free_port() - 2, "drone_port_base": free_port() - 2}
    config = plain.model_copy(update={"link": plain.link.model_copy(update=link)})
    log, events = tmp_path / "flight.mcap", []

    async def flooded() -> RunResult:
        flood = asyncio.create_task(_stray(config.link.ground_port_base + 2))
        try:
            return await _until_over(config, tmp_path, events)
        finally:
            flood.cancel()

    ended = asyncio.run(flooded())
    assert check_log(log).entries["mocap/frame"] == ended.timing.ticks
    assert "link/up" not in check_log(log).entries
    entries = list(read_log(log).entries)
    frames = [entry.message.seq for entry in entries if entry.topic is topics.MOCAP]
    assert len(frames) > 0.8 * 100  # every one of them on a machine with a core to spare
    refused = [entry for entry in entries if entry.topic is topics.REJECTED]
    assert {entry.message.source for entry in refused} == {"127.0.0.1"}
    assert all(b.t_ns - a.t_ns >= 1_000_000_000 for a, b in pairwise(refused))
    assert [event for event in events if event.source == "127.0.0.1"] == [entry.message for entry in refused]


class _Knowing:
    """In a ground's place: it is told who else is alive."""

    other_grounds: tuple[str, ...] = ()


def test_grounds_of_one_lab_know_of_each_other_for_as_long_as_they_live():
    async def meet() -> None:
        config = a_lab()
        one, other = await hub_of(config), await ZenohBus.open(config.link, config.name)
        old, new = _Knowing(), _Knowing()
        know_other_grounds(one, "main", 100, old)
        know_other_grounds(other, "main", 107, new)
        async with asyncio.timeout(30.0):
            while not (old.other_grounds and new.other_grounds):
                await asyncio.sleep(0.01)
        assert (old.other_grounds, new.other_grounds) == ((f"main/107-{os.getpid()}",), (f"main/100-{os.getpid()}",))
        await other.close()
        async with asyncio.timeout(30.0):
            while old.other_grounds:
                await asyncio.sleep(0.01)
        await one.close()

    asyncio.run(meet())
