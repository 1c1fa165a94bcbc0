"""A flight in real time by real processes: the mocap emulator, one agent a drone, and `gcs run`, over real links."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from formation.messages import OperatorReply, OperatorRequest
from formation.model import Model
from gcs.daemon import GCS_NAME
from sim.processes import Child, ProcessGroup
from sim.scenario import Scenario, agent_configs, leader_seconds, recorded_leader
from sim.script import Glance, Operator, Outcome
from wire import clock, config_file
from wire.zenoh_bus import ZenohBus

Progress = Callable[[float, str], None]
"""Told the seconds since the processes were started, and what is going on."""

TRUTH_RATE_HZ = 250.0
LOOK_NS = 50_000_000
ANSWER_S = 25.0
LANDING_PATIENCE_S = 20.0
START_WITHIN_NS = 60_000_000_000
SILENT_NS = 3_000_000_000
AFTER_NS = 500_000_000
"""What is still recorded after the flight has ended."""


@dataclass(frozen=True, slots=True)
class Files:
    """The run directory of one flight."""

    folder: Path

    @property
    def mcap(self) -> Path:
        """The ground's log."""
        return self.folder / "flight.mcap"

    @property
    def report(self) -> Path:
        """The page about the flight."""
        return self.folder / "report.html"

    @property
    def scenario(self) -> Path:
        """The scenario as it was flown."""
        return self.folder / "scenario.toml"

    @property
    def lab(self) -> Path:
        """What the ground was told."""
        return self.folder / "lab.toml"

    def agent(self, sysid: int) -> Path:
        """What the agent was told."""
        return self.folder / f"agent-{sysid}.toml"


@dataclass(frozen=True, slots=True)
class Running:
    """A flight's processes, and the operator's place on their bus."""

    group: ProcessGroup
    ground: Child
    bus: ZenohBus


@asynccontextmanager
async def running(scenario: Scenario, seed: int, files: Files, force: bool = False) -> AsyncIterator[Running]:
    """All processes of the scenario, logging into `files`; on leaving the ground is stopped first, and lands."""
    _write(files.scenario, scenario)
    _write(files.lab, scenario.lab)
    async with ProcessGroup(files.folder) as group:
        await group.start("cameras", "sim", ["mocap", str(files.scenario), "--seed", str(seed)])
        await group.start("mocap", "gcs", ["mocap", str(files.lab)])
        for config in agent_configs(scenario, recorded_leader(scenario)):
            file = files.agent(config.sysid)
            _write(file, config.model_copy(update={"truth_rate_hz": TRUTH_RATE_HZ}))
            await group.start(f"agent-{config.sysid}", "drone_agent", ["--config", str(file)])
        tags = ("--tag", f"scenario={scenario.name}", "--tag", f"seed={seed}")
        arguments = ["run", str(files.lab), "--log", str(files.mcap), *tags, *(["--force"] if force else [])]
        ground = await group.start("gcs", "gcs", arguments, patience_s=LANDING_PATIENCE_S)
        bus = await ZenohBus.open(scenario.lab.link, scenario.lab.name)
        try:
            yield Running(group, ground, bus)
        finally:
            await bus.close()


async def fly(scenario: Scenario, seed: int, files: Files, progress: Progress, force: bool = False) -> Outcome:
    """Fly the scenario (its lab says over which link) to its end; every process is gone at return.

    Cancelling it (Ctrl-C) lands the drones and stops the processes as cleanly. A process that dies in flight is an
    outcome, not an error. force: gains whose delay margin the ground would refuse are flown all the same.
    Raises what a wrong scenario raises, and BusError.
    """
    operator = Operator(scenario.script, leader_seconds(scenario, recorded_leader(scenario)))
    async with running(scenario, seed, files, force) as flight:
        return await _first(flight.group.watch(), operate(flight.bus, operator, scenario.longest_s, progress))


def _write(path: Path, model: Model) -> None:
    path.write_text(config_file.dump(model), encoding="utf-8")


async def _first(watch: Coroutine[None, None, None], flight: Coroutine[None, None, Outcome]) -> Outcome:
    """The flight's outcome, or that a process has died before it."""
    watching, flying = asyncio.create_task(watch), asyncio.create_task(flight)
    try:
        await asyncio.wait((watching, flying), return_when=asyncio.FIRST_COMPLETED)
        return flying.result() if flying.done() else Outcome("aborted", str(watching.exception()))
    finally:
        for task in (watching, flying):
            task.cancel()
        await asyncio.gather(watching, flying, return_exceptions=True)


class _Conversation:
    """The operator's side of the bus: hears the ground's state, makes requests, takes in the answers."""

    def __init__(self, bus: ZenohBus, operator: Operator) -> None:
        self.heard_ns: int | None = None
        self._bus = bus
        self._operator = operator
        bus.on_state(GCS_NAME, self._hear)

    async def ask(self, request: OperatorRequest) -> None:
        """Make the request and wait for its answer; no answer is one of refusal."""
        try:
            reply = await self._bus.ask(GCS_NAME, request, ANSWER_S)
        except TimeoutError as error:
            reply = OperatorReply(request.id, False, str(error))
        self._operator.receive(reply, clock.monotonic_ns())

    def _hear(self, text: str) -> None:
        self.heard_ns = clock.monotonic_ns()
        self._operator.observe(Glance.at(text), self.heard_ns)


async def operate(bus: ZenohBus, operator: Operator, longest_s: float, progress: Progress) -> Outcome:
    """Walk through the operator's script until the flight is over, one way or another."""
    talk = _Conversation(bus, operator)
    start_ns = clock.monotonic_ns()
    async with asyncio.TaskGroup() as asking:
        while operator.outcome is None:
            now_ns = clock.monotonic_ns()
            silent = _silence(start_ns, talk.heard_ns, now_ns)
            if silent:
                return Outcome("aborted", silent)
            if now_ns - start_ns > longest_s * 1e9:
                return Outcome("aborted", f"not over after {longest_s:g} s")
            request = operator.next_request(now_ns)
            if request is not None:
                asking.create_task(talk.ask(request))
            progress((now_ns - start_ns) * 1e-9, "starting" if talk.heard_ns is None else operator.phase.name)
            await clock.sleep_until_ns(now_ns + LOOK_NS)
    await clock.sleep_until_ns(clock.monotonic_ns() + AFTER_NS)
    return operator.outcome


def _silence(start_ns: int, heard_ns: int | None, now_ns: int) -> str:
    """What is wrong with a ground that has not been heard for too long; empty where nothing is."""
    if heard_ns is None:
        return "the ground did not come up" if now_ns - start_ns > START_WITHIN_NS else ""
    return "the ground has fallen silent" if now_ns - heard_ns > SILENT_NS else ""
