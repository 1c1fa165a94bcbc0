"""The ground as a process: pumps frames, datagrams and requests into GcsCore and its output out. It decides nothing.

A frame triggers the tick; a timer only watches for one that does not come. Any failure inside ends the process with
its reason: setpoints stop, and every drone's guard holds and lands it by its own rule. `serve` is what `gcs run` does
around it: margins, warm-up, the terminal, exit codes.
"""

import asyncio
import json
import os
import signal
import sys
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from traceback import walk_tb
from typing import Any

import uvloop
import zenoh

from formation import topics
from formation.clock_pair import ClockPair
from formation.config import LabConfig, LinkConfig, VehicleBody
from formation.exposure import GROUND
from formation.messages import (
    Datagram,
    Event,
    HostReport,
    LabFrame,
    LoopTiming,
    OperatorReply,
    OperatorRequest,
    Phase,
    Severity,
    UnmetParameter,
    Verb,
)
from formation.requests import ENDPOINT, GCS_NAME, time_ns
from gcs.alarms import EventMemory
from gcs.core import GcsCore
from gcs.doctor.restart_record import watch_record
from gcs.drones.links import close_links, open_links, open_shared
from gcs.lab.findings import judge_margins
from gcs.recording import Input, Recorder, run_metadata
from gcs.security.roles import by_role
from gcs.spare import asked_of
from gcs.stop_button import watch_button
from gcs.warm_up import warm_up
from mocap.service import ServiceError, mocap_service
from wire.clock import REAL_TIME, Clock, unix_us
from wire.files import make_folder
from wire.ground_state import Cycles, LogFile, encode
from wire.logs.live import sharer
from wire.logs.mcap_write import LogWriter, record_dates
from wire.process.daemon import (
    READY,
    EventSink,
    LoopErrors,
    Precondition,
    Watchdog,
    beside,
    bus_at,
    notify,
    report_missing,
)
from wire.process.deadline import Deadline
from wire.process.output import lost_lines
from wire.process.program import fail, print_event, print_event_json
from wire.process.progress import compile_all
from wire.process.system import NOT_LANDED, NOT_RIGHT, REJECTED, machine, prefer_process, raise_priority
from wire.security.private_keys import keys_folder, read_operations
from wire.security.protection import INSECURE, LOOPBACK_ONLY, Protection, lab_protection
from wire.transport.link import Link
from wire.transport.mocap_bus import MocapBus
from wire.transport.stop_port import stop_ports
from wire.transport.zenoh_bus import Reply, ZenohBus

BORROWED = Event(
    Severity.WARNING, "ground", "the bus is another ground's or a router's, and ends with it: give this lab a port of "
    "its own, [link] zenoh_listen"
)  # fmt: skip
LISTENS = Event(Severity.INFO, "ground", f"the lab file names no bus (link.zenoh_connect): it is here, at {ENDPOINT}")
STATE_NS = 100_000_000
STATUS_NS = 20_000_000
"""For so long a state that was worked out answers every status request: a flood of them costs the control nothing."""
GROUNDED = (Phase.GROUND, Phase.STOPPED)
LANDING_LIMIT_NS = 60_000_000_000
LAW_S, LAW_WALL_S, LAW_USUAL_S = 0.01, 0.05, 0.002
"""For the lab's own laws in one tick: of computing, of any kind, and of computing for each follower more than once;
setpoints are stale after 0.1 s."""


@dataclass(slots=True)
class Timing:
    """How the loop has kept up: ticks on a frame, how many were late, and the worst latency."""

    ticks: int = 0
    late: int = 0
    worst_s: float = 0.0


class Ground:
    """One GcsCore between its inputs and its links. Everything runs on the event loop, in order of arrival."""

    def __init__(self, config: LabConfig, core: GcsCore, log: LogWriter, report: EventSink, clock: Clock) -> None:
        self.timing = Timing()
        self.links: Mapping[int, Link] = {}
        """By sysid; before they are open nothing is sent."""
        self.open_link: Callable[[int], Awaitable[Link]] | None = None
        """Opens the link of one more system id; None in a lab with keys, which are made by system id."""
        self._opening: asyncio.Task[None] | None = None
        self._core = core
        self.log = log
        self._recorder = Recorder(log.write)
        self._print_event = report
        self._events = EventMemory()
        self.log_file = LogFile(log.path.name)
        self.button_trouble = self.exposed = ""
        self._clock = clock
        self._watchdog = Watchdog()
        self._spacing_s = 1.0 / config.mocap.rate_hz
        self.received_sysids: set[int] = set()
        """System ids of the drones that have sent a datagram."""
        self.has_frame = False
        self._pending_replies: dict[int, Reply] = {}
        self._state = ""
        self._state_ns: int | None = None
        self._host_report = HostReport()
        self.other_grounds: tuple[str, ...] = ()
        """Those that are alive on the lab's bus."""
        self._request_id = 0
        self._frame_seq, self._frame_ns = -1, 0
        self._received_ns: int | None = None
        self._tick_scheduled = False
        self._ticked = asyncio.Event()
        """Set by every tick; without frames the watchdog makes them."""
        self._watched_ns, self._earlier = 0, asyncio.Event()
        """Until when the watchdog sleeps, and an earlier deadline: of a motor cut that is to be repeated."""
        self._loop = asyncio.get_running_loop()

    def receive_frame(self, frame: LabFrame) -> None:
        """Receive a frame and run a control tick at once."""
        now_ns = self._clock.monotonic_ns()
        self._input(frame, now_ns)
        self.has_frame = True
        self._frame_seq, self._frame_ns, self._received_ns = frame.seq, now_ns, now_ns
        self._tick(now_ns)

    def receive_datagram(self, datagram: Datagram) -> None:
        """Receive a datagram of a drone; replies wait until everything that has arrived is read."""
        now_ns = self._clock.monotonic_ns()
        self.received_sysids.add(datagram.sysid)
        self._input(datagram, now_ns)
        if self._core.next_deadline_ns() <= now_ns and not self._tick_scheduled:
            self._tick_scheduled = True
            self._loop.call_soon(self._tick_if_due)

    def receive_request(self, request: OperatorRequest, reply: Reply) -> None:
        """Receive an operator's request. It gets an id of ours: operators' ids may clash. A status costs no tick."""
        now_ns = self._clock.monotonic_ns()
        if request.verb is Verb.STATUS:
            reply(OperatorReply(request.id, True, self._state_text(now_ns)))
            return
        sysid = asked_of(request)[1] if request.verb is Verb.REPLACE and self.phase is Phase.GROUND else 0
        is_opening = self._opening is not None and not self._opening.done()
        if sysid and sysid not in self.links and self.open_link is not None and not is_opening:
            self._opening = self._loop.create_task(self._open_and_ask(self.open_link(sysid), sysid, request, reply))
            return
        self._request_id += 1
        self._state_ns = None
        asked_id = request.id
        self._pending_replies[self._request_id] = lambda answer: reply(replace(answer, id=asked_id))
        if request.verb is Verb.START:
            request = replace(request, argument=on_own_clock(request.argument, self._clock.pair()))
        self._input(replace(request, id=self._request_id), now_ns)
        self._tick(now_ns)

    async def _open_and_ask(self, opening: Awaitable[Link], sysid: int, request: OperatorRequest, reply: Reply) -> None:
        """Hear a spare first, then ask; a link that cannot be opened is the answer."""
        try:
            self.links = {**self.links, sysid: await opening}
        except OSError as error:
            self.report_beside(Event(Severity.NOTICE, "operator", f"{request.verb} refused: {error}"))
            reply(OperatorReply(request.id, False, str(error)))
            return
        self.receive_request(request, reply)

    async def watch(self) -> None:
        """Tick where a frame is overdue, which makes the tick late, or an answer waits, which does not; for ever."""
        while True:
            self._watched_ns = self._core.next_deadline_ns()
            self._earlier.clear()
            await self._clock.sleep_until_ns(self._watched_ns, self._earlier)
            now_ns = self._clock.monotonic_ns()
            if now_ns >= self._core.next_deadline_ns():
                is_flying = self._frame_seq >= 0 and self._core.phase not in GROUNDED
                is_overdue = now_ns - self._frame_ns >= self._core.watchdog_ns
                self._tick(now_ns)
                if is_flying and is_overdue:
                    self._note((self._clock.monotonic_ns() - now_ns) * 1e-9, late=True)

    def receive_mocap_event(self, event: Event) -> None:
        """Receive an event of the mocap process."""
        self.log.write(topics.MOCAP_EVENT, event, self._clock.monotonic_ns())
        self.report(event)

    async def publish_state(self, bus: ZenohBus, name: str) -> None:
        """Publish the state and report rejected inputs, ten times a second; runs until cancelled.

        Just after a tick, when the next frame is a whole period away: no frame waits until the state is assembled.
        """
        while True:
            now_ns = self._clock.monotonic_ns()
            self._report_host(now_ns)
            bus.publish_state(name, self._state_text(now_ns))
            for event in bus.rejections.due(now_ns):
                self._report_beside_at(event, now_ns)
            await self._clock.sleep_until_ns(now_ns + STATE_NS - round(0.5e9 * self._spacing_s))
            self._ticked.clear()
            await self._ticked.wait()

    def _state_text(self, now_ns: int) -> str:
        """Everything that is published of the ground, as JSON, at most STATUS_NS old."""
        if self._state_ns is None or now_ns - self._state_ns > STATUS_NS:
            timing = self.timing
            state = replace(
                self._core.state(now_ns),
                cycles=Cycles(timing.ticks, timing.late, round(timing.worst_s * 1e3, 2)),
                log=self.log_file,
                events=self._events.newest,
                alarms=self._events.alarms.open,
                lost_lines=lost_lines(),
            )
            self._state, self._state_ns = encode(state), now_ns
        return self._state

    def _report_host(self, now_ns: int) -> None:
        """Pass the state of log, bus and stop button to the core when it has changed."""
        report = HostReport(self.other_grounds, self.log.trouble(now_ns), self.button_trouble, self.exposed)
        if report != self._host_report:
            self._host_report = report
            self._input(report, now_ns)
            self._tick(now_ns)

    async def watch_disk(self) -> None:
        """Read the free disk space once a second, in a thread: a disk may answer late; runs until cancelled."""
        while True:
            self.log_file = await asyncio.to_thread(_measured, self.log.path)
            await self._clock.sleep_until_ns(self._clock.monotonic_ns() + 1_000_000_000)

    def receive_unmet(self, unmet: UnmetParameter) -> None:
        """Receive a parameter that the doctor has recorded: it takes effect at a restart."""
        self._input(unmet, self._clock.monotonic_ns())

    def booted_ns(self, sysid: int) -> int | None:
        """When that drone's autopilot booted; None where that is not known."""
        return self._core.booted_ns(sysid)

    def press(self) -> None:
        """Stop: the stop button was pressed."""
        self.receive_request(OperatorRequest(0, Verb.STOP, "stop button"), lambda _reply: None)

    def report_beside(self, event: Event) -> None:
        """Report and record what the process refuses, or fails in, beside the core."""
        self._report_beside_at(event, self._clock.monotonic_ns())

    def _report_beside_at(self, event: Event, now_ns: int) -> None:
        self.log.write(topics.REJECTED, event, now_ns)
        self.report(event)

    def report(self, event: Event) -> None:
        """Print an event on the terminal, and keep it for the published state."""
        self._events.note(event, unix_us())
        self._print_event(event)

    async def land(self) -> None:
        """Bring the swarm down and wait for it, within a limit."""
        deadline_ns = self._clock.monotonic_ns() + LANDING_LIMIT_NS
        if self._core.phase not in GROUNDED:
            self.receive_request(OperatorRequest(0, Verb.LAND), lambda _reply: None)
        while self._core.phase not in GROUNDED and self._clock.monotonic_ns() < deadline_ns:
            await self._clock.sleep_until_ns(self._clock.monotonic_ns() + STATE_NS)

    @property
    def phase(self) -> Phase:
        """The swarm's phase."""
        return self._core.phase

    def _input(self, message: Input, now_ns: int) -> None:
        self._recorder.input(message, now_ns)
        self._core.receive(message, now_ns)

    def _tick_if_due(self) -> None:
        self._tick_scheduled = False
        now_ns = self._clock.monotonic_ns()
        if self._core.next_deadline_ns() <= now_ns:
            self._tick(now_ns)

    def _tick(self, now_ns: int) -> None:
        """Tick, send, then record; the cycle of a frame ends when the last datagram was handed to its link."""
        outgoing = self._core.tick(now_ns)
        self._watchdog.feed(now_ns)
        for datagram in outgoing.datagrams if self.links else ():
            self.links[datagram.sysid].send(datagram)
        sent_ns = self._clock.monotonic_ns()
        self._recorder.tick(outgoing, now_ns)
        for reply in outgoing.replies:
            self._pending_replies.pop(reply.id)(reply)
        for topic, message in outgoing.records:
            if topic is topics.EVENT and isinstance(message, Event):
                self.report(message)
        if self._received_ns is not None:
            latency_s = (sent_ns - self._received_ns) * 1e-9
            self._received_ns = None
            self._note(latency_s, late=latency_s > self._spacing_s)
        self._ticked.set()
        if self._core.next_deadline_ns() < self._watched_ns:
            self._earlier.set()

    def _note(self, latency_s: float, late: bool) -> None:
        timing = self.timing
        timing.ticks, timing.late = timing.ticks + 1, timing.late + late
        timing.worst_s = max(timing.worst_s, latency_s)
        if late or self._recorder.detailed:
            self.log.write(topics.TIMING, LoopTiming(self._frame_seq, latency_s, late), self._clock.monotonic_ns())


OF_THE_CORE = tuple(f.__code__ for f in (Ground.receive_datagram, Ground._input, Ground._tick))
"""What is raised in these ends the ground, whoever called them."""


def _measured(log: Path) -> LogFile:
    """The log and its disk as the file system says now; it may take its time."""
    try:
        usage = os.statvfs(log)
        return LogFile(log.name, log.stat().st_size, usage.f_bavail * usage.f_frsize)
    except OSError:  # the log's own trouble says more, and is an alarm
        return LogFile(log.name)


class GroundFailure(RuntimeError):
    """The ground failed and ended itself; the text says why."""


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run of the ground ended. cause: of its last phase; not_landed: drones whose motors may still turn."""

    phase: Phase
    cause: str
    timing: Timing
    lost_records: int
    not_landed: tuple[str, ...]
    log: Path


def on_own_clock(date: str, pair: ClockPair) -> str:
    """A date, ns since 1970, on the clock of that pair; what is none stays as it is, and is rejected."""
    unix_ns = time_ns(date)
    return date if unix_ns is None else str(unix_ns - pair.ahead_ns)


async def run(
    config: LabConfig,
    lab_file: Path,
    log_path: Path,
    name: str,
    metadata: Mapping[str, str],
    report: EventSink,
    clock: Clock = REAL_TIME,
    protection: Protection = LOOPBACK_ONLY,
    overwrite: bool = False,
) -> RunResult:
    """Run the ground until SIGINT or SIGTERM; in flight it lands the swarm first, a second signal ends it at once.

    lab_file: where `config` was read, for the mocap process, if one has to be started. protection: of every link.
    overwrite: a log that is there. Raises OSError (bus, ports, log), ValueError (a link that is none), ServiceError
    (no mocap), GroundFailure.
    """
    start = clock.pair()
    t0_ns, session = start.monotonic_ns, start.unix_ns // 1_000_000_000
    guard = Deadline(LAW_S, LAW_WALL_S, LAW_USUAL_S * len(config.commanded))
    core = GcsCore(config, t0_ns, session, law_guard=guard)
    bus = await ZenohBus.open_or_listen(config.link, config.name, protection=protection)
    try:
        log_metadata = {
            **run_metadata(config, t0_ns, session),
            "lab_file": str(lab_file),
            "machine": machine(),
            "security": protection.words,
            **metadata,
        }
        with LogWriter(log_path, log_metadata, start=start, share=sharer(bus, name), overwrite=overwrite) as log:
            ground = Ground(config, core, log, report, clock)
            ground.exposed = INSECURE if protection.bus.insecure else ""
            if bus.listens and not config.link.names_bus:
                ground.report(LISTENS)
            elif bus.is_joined and not config.link.names_bus:
                ground.report(BORROWED)
            ground.links = await open_links(config, bus, ground.receive_datagram)
            if config.security is None:
                ground.open_link = lambda sysid: open_shared(config, bus, [sysid], ground.receive_datagram)
            try:
                know_other_grounds(bus, name, session, ground)
                await _serve(config, lab_file, ground, bus, name, clock)
            except BaseExceptionGroup as group:
                raise _first_failure(group) from group
            finally:
                close_links(ground.links)
        state = core.state(clock.monotonic_ns())
        return RunResult(ground.phase, state.cause, ground.timing, log.lost, state.not_landed, log.path)
    finally:
        await bus.close()


async def _serve(config: LabConfig, lab_file: Path, ground: Ground, bus: ZenohBus, name: str, clock: Clock) -> None:
    """Everything that runs at once, until asked to end or until a part of it fails."""
    loop = asyncio.get_running_loop()
    asked_to_end, failure, others = asyncio.Event(), loop.create_future(), LoopErrors(ground.report_beside)

    def fail(error: BaseException) -> None:
        if not failure.done():
            failure.set_exception(error)

    def on_error(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        """A callback that raises has no task to fail: this is where the core's own errors arrive, among others."""
        error = context.get("exception")
        if error is not None and any(frame.f_code in OF_THE_CORE for frame, _ in walk_tb(error.__traceback__)):
            fail(error)
        else:
            others.receive(context)

    def on_signal() -> None:
        if asked_to_end.is_set():
            fail(GroundFailure("interrupted before the swarm had landed"))
        asked_to_end.set()

    loop.set_exception_handler(on_error)
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, on_signal)
    mocap = MocapBus(bus, clock)
    mocap.on_event(ground.receive_mocap_event)  # before frames: who is sent those is known to listen to events by then
    mocap.on_frame(ground.receive_frame)
    parts = (  # an error of these lands nobody
        watch_button(config.operator.stop_button, ground),  # first: it is there from the first
        record_dates(ground.log, clock),
        ground.watch_disk(),
        watch_record(lab_file, ground.receive_unmet, ground.booted_ns, ground.report, clock),
        _await_others(config, bus, ground),
        bus.protection.attend(ground.report),
    )
    async with beside(*parts), asyncio.TaskGroup() as tasks:
        services = [
            tasks.create_task(_raise_from(failure)),
            tasks.create_task(ground.watch()),
            tasks.create_task(ground.publish_state(bus, name)),
            tasks.create_task(_have_mocap(config, lab_file, mocap, ground.report, clock, name)),
        ]
        names = bus.protection.names
        handler = by_role(config, ground.receive_request, bus.rejections, clock.monotonic_ns, names)
        bus.serve(name, handler)
        own_link = config.link if name == GCS_NAME else LinkConfig(zenoh_connect=())
        with stop_ports(own_link, config.name, bus.protection, handler, bus.rejections, ground.report):
            await asked_to_end.wait()
            await ground.land()
        for service in services:
            service.cancel()


async def _await_others(config: LabConfig, bus: ZenohBus, ground: Ground) -> None:
    """Report what is missing; with frames and drones heard the ground is ready."""
    await report_missing("ground", awaited_by_ground(config, bus, ground), ground.report, bus.others)
    notify(READY)


async def _have_mocap(
    config: LabConfig, lab_file: Path, mocap: MocapBus, report: EventSink, clock: Clock, name: str
) -> None:  # fmt: skip
    """See that a mocap process serves the lab; for ever."""
    async with mocap_service(config, lab_file, mocap, report, clock, name):
        await asyncio.get_running_loop().create_future()


async def _raise_from(failure: "asyncio.Future[None]") -> None:
    await failure


def _first_failure(group: BaseExceptionGroup[BaseException]) -> BaseException:
    """The first error of a nest of groups; what was foreseen stays itself, the rest becomes GroundFailure."""
    error: BaseException = group
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    if isinstance(error, GroundFailure | OSError | ServiceError):
        return error
    return GroundFailure(f"{type(error).__name__}: {error}")


def awaited_by_ground(config: LabConfig, bus: ZenohBus, ground: Ground) -> list[Precondition]:
    """The bus where another listens, frames, and each drone."""
    awaited = []
    if not bus.listens:
        remedy = "nobody is there: start the router, or leave link.zenoh_connect out, and the ground listens itself"
        awaited.append(bus_at(config.link.zenoh_connect, lambda: bus.is_joined, remedy))
    remedy = "none has come: `gcs mocap discover` finds camera systems, `gcs doctor` says what is amiss"
    awaited.append(Precondition(f"frames of mocap source {config.mocap.source!r}", lambda: ground.has_frame, remedy))
    return awaited + [_awaited_drone(config.vehicles[i], ground) for i in config.commanded]


def _awaited_drone(vehicle: VehicleBody, ground: Ground) -> Precondition:
    sysid = vehicle.sysid or 0
    where = f"at its link {vehicle.link}" if vehicle.link else f"as system {sysid}"
    remedy = f"nothing is heard {where}: is it on, and its bridge (`drone-agent --sysid {sysid} --bridge ...`)?"
    return Precondition(f"drone {vehicle.body}", lambda: sysid in ground.received_sysids, remedy)


def know_other_grounds(bus: ZenohBus, name: str, session: int, ground: Ground) -> None:
    """Be known on the lab's bus as a ground that is alive, and know of the others."""
    own = f"{name}/{session}-{os.getpid()}"
    alive: set[str] = set()

    def on_token(sample: zenoh.Sample) -> None:
        other = str(sample.key_expr).removeprefix(f"{bus.lab}/ground/")
        if sample.kind == zenoh.SampleKind.DELETE:
            alive.discard(other)
        elif other != own:
            alive.add(other)
        ground.other_grounds = tuple(sorted(alive))

    bus.declare_token(f"ground/{own}")
    bus.watch_tokens("ground/**", on_token)


@dataclass(frozen=True, slots=True)
class RunOptions:
    """The options of `gcs run`. force: fly a preset that the delay margin refuses; insecure: without keys.

    priority: before other processes, in real time, where the machine allows it.
    """

    lab_file: Path
    log: Path
    name: str
    metadata: dict[str, str]
    force: bool
    as_json: bool
    insecure: bool
    priority: bool
    clock: Clock
    overwrite: bool


def serve(config: LabConfig, options: RunOptions) -> None:
    """Run the ground until SIGINT or SIGTERM, then end the program with its exit code."""
    log, name, as_json = options.log, options.name, options.as_json
    report = print_event_json if as_json else print_event
    report(Event(Severity.INFO, "ground", f"starting for lab {config.name!r}, log {log}"))
    try:
        protection = lab_protection(config.security, options.lab_file, GROUND, insecure=options.insecure)
        compile_all("gcs", lambda: warm_up(config), sys.stderr)
        reasons = "; ".join(f"{found.why} ({found.wanted})" for found in judge_margins(config))
        if reasons and not options.force:
            fail(f"refused: {reasons} (--force, for simulation only)", REJECTED)
        make_folder(log.parent)
        # After the compiler, before the threads that inherit it.
        priority = raise_priority() if options.priority else prefer_process()
        report(Event(Severity.INFO, "ground", f"priority: {priority}"))
        metadata = options.metadata | _key_operations(config, options.lab_file) | {"priority": priority}
        ended = uvloop.run(
            run(
                config, options.lab_file, log, name, metadata, report, options.clock, protection, options.overwrite
            )
        )  # fmt: skip
    except ServiceError as error:
        fail(str(error), error.code)
    except ValueError as error:
        fail(str(error), NOT_RIGHT)
    except OSError as error:
        fail(str(error), REJECTED)
    except GroundFailure as error:
        fail(f"the ground has failed and ends, the drones land by themselves: {error}", REJECTED)
    _report(ended, as_json, priority)


def _key_operations(config: LabConfig, lab_file: Path) -> dict[str, str]:
    """For the log: what was done to the lab's keys."""
    if config.security is None:
        return {}
    return {"key_operations": read_operations(keys_folder(config.security.keys, lab_file))}


def _report(ended: RunResult, as_json: bool, priority: str) -> None:
    timing = ended.timing
    worst_ms = round(timing.worst_s * 1e3, 2)
    if as_json:
        summary = {
            "phase": ended.phase.name, "cause": ended.cause, "not_landed": ended.not_landed,
            "ticks": timing.ticks, "late_ticks": timing.late,
            "worst_latency_ms": worst_ms, "priority": priority, "lost_records": ended.lost_records,
            "mcap": str(ended.log),
        }  # fmt: skip
        print(json.dumps(summary))
    else:
        print(f"{timing.ticks} ticks, {timing.late} late, worst {worst_ms} ms; priority {priority}; log {ended.log}")
    if ended.not_landed:
        fail(f"ended with {', '.join(ended.not_landed)} not known to have landed ({ended.cause})", NOT_LANDED)
