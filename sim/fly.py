"""A flight in real time by real processes: the mocap emulator, one agent a drone, and `gcs run`, over real links."""

import asyncio
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from drone_agent.bridge import BridgeConfig
from drone_agent.config import SimulatedDroneConfig
from drone_agent.guard.config import GuardConfig
from formation.codes import FlightResult, Outcome
from formation.config import LinkConfig
from formation.exposure import TOOL
from formation.messages import OperatorReply, OperatorRequest
from formation.model import Model
from formation.requests import GCS_NAME
from gcs.cli.children import page_process
from sim.ports import private_link
from sim.processes import Child, ProcessDied, ProcessGroup
from sim.scenario import Scenario, agent_configs, leader_seconds, recorded_leader
from sim.script import Operator, OperatorView
from wire import config_file
from wire.clock import REAL_TIME, Clock
from wire.ground_state import decode
from wire.security.private_keys import keys_folder
from wire.security.protection import lab_protection
from wire.transport.zenoh_bus import ZenohBus

Progress = Callable[[float, str], None]
"""Called with the seconds since the processes' start, and the state of the flight."""

TRUTH_RATE_HZ = 250.0
POLL_NS = 50_000_000
ANSWER_S = 25.0
LANDING_PATIENCE_S = 20.0
SILENT_NS = 3_000_000_000
AFTER_NS = 500_000_000
"""Time that is still recorded after the flight has ended."""


@dataclass(frozen=True, slots=True)
class Files:
    """The run directory of one flight."""

    folder: Path
    log_folder: Path | None = None
    """Where the ground's log goes, where that is another folder."""
    overwrite: bool = False
    """Whether the ground's log takes the place of one that is there."""

    @property
    def mcap(self) -> Path:
        """The ground's log."""
        return (self.log_folder or self.folder) / "flight.mcap"

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
        """The ground's configuration."""
        return self.folder / "lab.toml"

    def drone(self, name: str) -> Path:
        """The configuration of an agent or a bridge."""
        return self.folder / f"{name}.toml"


@dataclass(frozen=True, slots=True)
class FlightProcesses:
    """A flight's processes, and the operator's session on their bus."""

    group: ProcessGroup
    ground: Child
    bus: ZenohBus


@asynccontextmanager
async def simulated(
    scenario: Scenario,
    seed: int,
    files: Files,
    clock: Clock = REAL_TIME,
    drones_link: LinkConfig | None = None,
    hosts: int | None = None,
) -> AsyncIterator[ProcessGroup]:
    """The simulated laboratory: cameras and drones, without mocap process, ground and operator.

    drones_link: the drones' own end of their links, where something stands between them and the lab's. hosts: so many
    processes share the simulated drones; None: each is one.
    """
    _write(files.scenario, scenario)
    _write(files.lab, scenario.lab)
    speed = ("--speed", str(clock.speed))
    configs, security = agent_configs(scenario, recorded_leader(scenario)), scenario.lab.security
    bridged = [config.sysid for config in configs if scenario.true_vehicle(config.sysid).bridged]
    async with AsyncExitStack() as stack:
        inner = stack.enter_context(private_link("udp", bridged)) if bridged else None
        group = await stack.enter_async_context(ProcessGroup(files.folder))
        await group.start("cameras", "sim", ["mocap", str(files.scenario), "--seed", str(seed), *speed])
        agents: list[Path] = []
        for config in configs:
            if drones_link is not None:
                config = config.model_copy(update={"link": drones_link})
            if security is not None:
                config = config.model_copy(update={"keys": keys_folder(security.keys, files.lab)})
            for name, agent_config in _drone(config, inner if config.sysid in bridged else None):
                _write(files.drone(name), agent_config)
                if hosts is None or isinstance(agent_config, BridgeConfig):
                    await group.start(name, "drone_agent", ["--config", str(files.drone(name)), *speed])
                else:
                    agents.append(files.drone(name))
        for k in range(min(hosts or 0, len(agents))):
            share = [word for file in agents[k::hosts] for word in ("--config", str(file))]
            await group.start(f"host-{k + 1}", "drone_agent", [*share, *speed])
        yield group


@asynccontextmanager
async def running(
    scenario: Scenario,
    seed: int,
    files: Files,
    force: bool = False,
    clock: Clock = REAL_TIME,
    drones_link: LinkConfig | None = None,
    page: bool = False,
    hosts: int | None = None,
) -> AsyncIterator[FlightProcesses]:
    """All processes of the scenario, logging into `files`; on leaving the ground is stopped first, and lands.

    page: serve the operator's page, too. drones_link, hosts: as of `simulated`.
    """
    speed = ("--speed", str(clock.speed))
    async with AsyncExitStack() as stack:
        group = await stack.enter_async_context(simulated(scenario, seed, files, clock, drones_link, hosts))
        if page:
            stack.enter_context(page_process(files.lab, GCS_NAME, clock.speed))
        await group.start("mocap", "gcs", ["mocap", str(files.lab), *speed])
        tags = [
            f"scenario={scenario.name}",
            f"seed={seed}",
            *([] if clock == REAL_TIME else [f"speed={clock.speed:g}"]),
        ]
        arguments = ["run", str(files.lab), "--log", str(files.mcap), *speed, *(["--force"] if force else [])]
        arguments += ["--overwrite"] if files.overwrite else []
        arguments += [word for tag in tags for word in ("--tag", tag)]
        ground = await group.start("gcs", "gcs", arguments, patience_s=LANDING_PATIENCE_S / clock.speed)
        protection = lab_protection(scenario.lab.security, files.lab, TOOL)
        bus = await ZenohBus.open(scenario.lab.link, scenario.lab.name, protection=protection)
        try:
            yield FlightProcesses(group, ground, bus)
        finally:
            await bus.close()


async def fly(
    scenario: Scenario,
    seed: int,
    files: Files,
    progress: Progress,
    force: bool = False,
    clock: Clock = REAL_TIME,
    page: bool = False,
    hosts: int | None = None,
) -> Outcome:
    """Fly the scenario (its lab says over which link) to its end; every process is gone at return.

    Cancelling it (Ctrl-C) lands the drones and stops the processes as cleanly. A process that dies in flight is an
    outcome, not an error; `starved` where it is a simulator that the machine gives too little time. force: gains whose
    delay margin the ground would refuse are flown all the same. clock: of all processes. page: with the page. hosts:
    as of `running`. Raises what a wrong scenario raises, and BusError.
    """
    async with running(scenario, seed, files, force, clock, page=page, hosts=hosts) as flight:
        return await fly_on(flight, scenario, progress, clock)


async def practise(
    scenario: Scenario, seed: int, files: Files, report: Callable[[str], None], clock: Clock = REAL_TIME,
    hosts: int | None = None,
) -> None:  # fmt: skip
    """Cameras and drones alone, for people who are ground and operator; until it is cancelled. ProcessDied."""
    async with simulated(scenario, seed, files, clock, hosts=hosts) as group:
        report(
            f"Cameras and drones of {scenario.name} wait for a ground. Ctrl-C ends them. In other terminals:\n"
            f"    cd {files.folder}\n    gcs run {files.lab.name}\n"
            "    gcs arm; gcs takeoff; gcs start; gcs land"
        )
        await group.watch()


async def fly_on(flight: FlightProcesses, scenario: Scenario, progress: Progress, clock: Clock = REAL_TIME) -> Outcome:
    """Fly the scenario to its end by processes that are running."""
    operator = Operator(scenario.script, leader_seconds(scenario, recorded_leader(scenario)))
    return await _first(flight.group.watch(), operate(flight.bus, operator, scenario.longest_s, progress, clock))


def _drone(config: SimulatedDroneConfig, inner: LinkConfig | None) -> Iterator[tuple[str, GuardConfig]]:
    """A drone's processes: the agent, which shows its truth, and, where `inner` is its link to one, the bridge."""
    config = config.model_copy(update={"truth_rate_hz": TRUTH_RATE_HZ})
    if inner is None:
        yield f"agent-{config.sysid}", config
        return
    # It is on the bus for its truth alone.
    own = {"kind": "udp", "zenoh_connect": config.link.zenoh_connect}
    behind = {"link": inner.model_copy(update=own), "body": f"behind-{config.sysid}", "guard": False}
    yield f"agent-{config.sysid}", config.model_copy(update=behind)
    guards = {key: getattr(config, key) for key in GuardConfig.model_fields}
    autopilot = f"udp:{inner.host}:{inner.drone_port_base + config.sysid}"
    yield f"bridge-{config.sysid}", BridgeConfig(**guards, bridge=autopilot)


def _write(path: Path, model: Model) -> None:
    path.write_text(config_file.dump(model), encoding="utf-8")


async def _first(watch: Coroutine[None, None, None], flight: Coroutine[None, None, Outcome]) -> Outcome:
    """The flight's outcome, or that a process has died before it."""
    watching, flying = asyncio.create_task(watch), asyncio.create_task(flight)
    try:
        await asyncio.wait((watching, flying), return_when=asyncio.FIRST_COMPLETED)
        if not watching.done():
            return flying.result()
        died = watching.exception()
        return Outcome(
            FlightResult.STARVED if isinstance(died, ProcessDied) and died.starved else FlightResult.ABORTED, str(died)
        )
    finally:
        for task in (watching, flying):
            task.cancel()
        await asyncio.gather(watching, flying, return_exceptions=True)


class _Conversation:
    """The operator's side of the bus: receives the ground's state, makes requests, receives the answers."""

    def __init__(self, bus: ZenohBus, operator: Operator, clock: Clock) -> None:
        self.begun_ns: int | None = None
        self.received_ns: int | None = None
        self._clock = clock
        self._bus = bus
        self._operator = operator
        bus.on_state(GCS_NAME, self._receive_state)

    async def ask(self, request: OperatorRequest) -> None:
        """Make the request and wait for its answer; no answer counts as rejected."""
        try:
            reply = await self._bus.ask(GCS_NAME, request, ANSWER_S / self._clock.speed)
        except TimeoutError as error:
            reply = OperatorReply(request.id, False, str(error))
        self._operator.receive(reply, self._clock.monotonic_ns())

    def _receive_state(self, text: str) -> None:
        self.received_ns = self._clock.monotonic_ns()
        self.begun_ns = self.begun_ns or self.received_ns
        self._operator.observe(OperatorView.at(decode(text)), self.received_ns)


async def operate(
    bus: ZenohBus, operator: Operator, longest_s: float, progress: Progress, clock: Clock = REAL_TIME
) -> Outcome:
    """Walk through the operator's script until the flight is over, one way or another.

    However slowly the processes start, the flight begins with the ground's first state; longest_s counts from there.
    """
    talk = _Conversation(bus, operator, clock)
    start_ns = clock.monotonic_ns()
    async with asyncio.TaskGroup() as asking:
        while operator.outcome is None:
            now_ns = clock.monotonic_ns()
            begun_ns = talk.begun_ns or now_ns
            if now_ns - begun_ns > longest_s * 1e9:
                return Outcome(FlightResult.ABORTED, f"not over after {longest_s:g} s")
            request = operator.next_request(now_ns)
            if request is not None:
                asking.create_task(talk.ask(request))
            progress((now_ns - start_ns) * 1e-9, _going_on(talk, operator, now_ns))
            await clock.sleep_until_ns(now_ns + POLL_NS)
    await clock.sleep_until_ns(clock.monotonic_ns() + AFTER_NS)
    return operator.outcome


def _going_on(talk: _Conversation, operator: Operator, now_ns: int) -> str:
    """The phase, or what the flight waits for; the process group detects a ground that has died."""
    if talk.received_ns is None:
        return "waiting for the ground to start"
    return "waiting to hear the ground again" if now_ns - talk.received_ns > SILENT_NS else operator.phase.name
