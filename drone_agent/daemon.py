"""The drone agent's process: pumps a simulated drone between its link, the bus and the clock until it is stopped."""

import asyncio
import sys

from drone_agent.autopilots import parameter_file
from drone_agent.config import AgentConfig
from drone_agent.core import AgentCore
from drone_agent.guarded import GuardedDrone
from drone_agent.link.awaited import awaited_bus, awaited_pose
from drone_agent.link.ground_link import open_ground_link
from drone_agent.timer import DeadlineTimer
from drone_agent.warm_up import warm_up
from formation.messages import Datagram, LabFrame
from wire.clock import REAL_TIME, Clock
from wire.config_file import ConfigError
from wire.process.awaited import report_missing
from wire.process.lifetime import EventSink, Stop
from wire.process.progress import compile_all
from wire.process.starved import Punctuality
from wire.rejections import RejectionLog
from wire.transport.link import Link
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

Drone = GuardedDrone | AgentCore


class _Pump:
    """Hands what arrives to the core at once, and wakes it at its own deadlines."""

    def __init__(self, config: AgentConfig, core: Drone, report: EventSink, clock: Clock) -> None:
        self.link: Link | None = None
        self.bus: ZenohBus | None = None
        self.rejections = RejectionLog()
        self._config = config
        self._core = core
        self._report = report
        self._clock = clock
        self._flying = False
        self.has_pose = False
        """Whether the mocap has shown the body."""
        self._punctual = Punctuality(f"drone {config.sysid}", "its physics")
        self.timer = DeadlineTimer(self.turn, clock)

    def receive(self, datagram: Datagram) -> None:
        """The ground said something."""
        self._core.receive(datagram, self._punctual_ns())
        self.turn()

    def receive_frame(self, frame: LabFrame) -> None:
        """The mocap saw something, which is the guard's to use."""
        if not isinstance(self._core, GuardedDrone):
            return
        if not self.has_pose and self._config.body_name in frame.bodies:
            self.has_pose = bool(frame.seen[frame.bodies.index(self._config.body_name)])
        self._core.receive(frame, self._punctual_ns())
        self.turn()

    def turn(self) -> None:
        """Send what is due and sleep until the next deadline."""
        now_ns = self._punctual_ns()
        out = self._core.tick(now_ns)
        if self.link is not None:
            for datagram in out.datagrams:
                self.link.send(datagram)
        if self.bus is not None and out.truth is not None:
            self.bus.publish_truth(out.truth)
            self._flying = not out.truth.on_ground
        for event in (*out.events, *self.rejections.due(now_ns)):
            self._report(event)
        if out.parameters is not None and self._config.parameter_file is not None:
            parameter_file.write(self._config.parameter_file, out.parameters)
        self.timer.at(self._core.next_deadline_ns())

    def _punctual_ns(self) -> int:
        """Now; StarvedError where a flight under an emulated mocap, which needs the true poses, is too late."""
        now_ns = self._clock.monotonic_ns()
        if self._flying:
            self._punctual.check(self._core.next_deadline_ns(), now_ns)
        return now_ns


async def run(config: AgentConfig, report: EventSink, clock: Clock = REAL_TIME) -> None:
    """Be the drone until SIGINT or SIGTERM.

    Raises OSError where its port is taken, ConfigError for parameters that are none, StarvedError.
    """
    stop, protection = Stop(), config.protection
    pump = _Pump(config, _core(config, clock), report, clock)
    missing: asyncio.Task[None] | None = None
    attending: asyncio.Task[None] | None = None
    uses_bus = config.link.kind == "zenoh" or config.is_guarded or config.truth_rate_hz > 0.0
    try:
        if uses_bus:
            pump.bus = await ZenohBus.open(config.link, config.lab, pump.rejections, protection)
            MocapBus(pump.bus, clock).on_frame(pump.receive_frame)
        pump.link = await open_ground_link(config, pump.bus, pump.receive, pump.rejections, protection)
        pump.turn()
        if pump.bus is not None:
            awaited = [awaited_bus(config, pump.bus)]
            awaited += [awaited_pose(config, lambda: pump.has_pose)] if config.is_guarded else []
            missing = asyncio.create_task(report_missing(f"uav{config.sysid}", awaited, report))
        attending = asyncio.create_task(protection.attend(report))
        await stop.wait()
    finally:
        if attending is not None:
            attending.cancel()
        if missing is not None:
            missing.cancel()
        pump.timer.stop()
        if pump.link is not None:
            pump.link.close()
        if pump.bus is not None:
            await pump.bus.close()


def _core(config: AgentConfig, clock: Clock) -> Drone:
    """The core, its kernels compiled: nothing compiles in flight."""
    stored = {} if config.parameter_file is None else parameter_file.read(config.parameter_file)
    config = config.model_copy(update={"parameters": {**config.parameters, **stored}})
    try:
        core = (GuardedDrone if config.is_guarded else AgentCore)(config, clock.monotonic_ns())
    except ValueError as error:
        raise ConfigError([f"drone-agent: parameters: {error}"]) from error
    compile_all("drone-agent", lambda: _warm_up(core, clock), sys.stderr)
    return core


def _warm_up(core: Drone, clock: Clock) -> None:
    core.truth(clock.monotonic_ns())
    warm_up()
