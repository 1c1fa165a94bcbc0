"""The drone agent's process: pumps simulated drones between their links, the bus and the clock until it is stopped."""

import sys
from collections.abc import Sequence

from drone_agent.config import SimulatedDroneConfig
from drone_agent.core import AgentCore
from drone_agent.guard.core import warm_up
from drone_agent.guarded import GuardedDrone
from drone_agent.process import DeadlineTimer, awaited_bus, awaited_pose, drone_protection, open_ground_link
from drone_agent.simulation.airframe import Airframe, share_air
from formation.messages import Datagram, LabFrame
from wire.clock import REAL_TIME, Clock
from wire.errors import ConfigError
from wire.process.daemon import EventSink, Precondition, Punctuality, Stop, beside, report_missing
from wire.process.progress import compile_all
from wire.rejections import RejectionLog
from wire.transport.link import Link
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

Drone = GuardedDrone | AgentCore


class _Pump:
    """Hands what arrives to the core at once, and wakes it at its own deadlines."""

    def __init__(
        self, config: SimulatedDroneConfig, core: Drone, report: EventSink, clock: Clock, rejections: RejectionLog
    ) -> None:
        """rejections: of this process; whoever turns first reports them."""
        self.config = config
        self.link: Link | None = None
        self.bus: ZenohBus | None = None
        self._rejections = rejections
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
        if not self.has_pose and self.config.body_name in frame.bodies:
            self.has_pose = bool(frame.seen[frame.bodies.index(self.config.body_name)])
        self._core.receive_frame(frame, self._punctual_ns())
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
        for event in (*out.events, *self._rejections.due(now_ns)):
            self._report(event)
        self.timer.at(self._core.due_ns)

    def _punctual_ns(self) -> int:
        """Now; StarvedError where a flight under an emulated mocap, which needs the true poses, is too late."""
        now_ns = self._clock.monotonic_ns()
        if self._flying:
            self._punctual.check(self._core.due_ns, now_ns)
        return now_ns


async def run(configs: Sequence[SimulatedDroneConfig], report: EventSink, clock: Clock = REAL_TIME) -> None:
    """Be the drones until SIGINT or SIGTERM; one connection to the bus, as the first is configured, serves all.

    Raises OSError where a port is taken, ConfigError for parameters that are none, StarvedError.
    """
    stop, rejections, protections = Stop(report), RejectionLog(), [drone_protection(config) for config in configs]
    cores = [_core(config, clock) for config in configs]
    airframes = [(core.autopilot if isinstance(core, GuardedDrone) else core).airframe for core in cores]
    compile_all("drone-agent", lambda: _warm_up(cores, airframes, clock), sys.stderr)
    pumps = [_Pump(config, core, report, clock, rejections) for config, core in zip(configs, cores, strict=True)]
    bus: ZenohBus | None = None
    try:
        if any(c.link.kind == "zenoh" or c.is_guarded or c.truth_rate_hz > 0.0 for c in configs):
            bus = await ZenohBus.open(configs[0].link, configs[0].lab, rejections, protections[0])

            def receive_frame(frame: LabFrame) -> None:
                share_air(airframes)
                for pump in pumps:
                    pump.receive_frame(frame)

            MocapBus(bus, clock).on_frame(receive_frame)
        for pump, protection in zip(pumps, protections, strict=True):
            pump.bus = bus
            pump.link = await open_ground_link(pump.config, bus, pump.receive, rejections, protection)
            pump.turn()
        parts = [protection.attend(report) for protection in protections]
        if bus is not None:
            parts += [
                report_missing(f"uav{pump.config.sysid}", awaited, report, bus.others)
                for pump, awaited in zip(pumps, _awaited(pumps, bus), strict=True)
            ]
        async with beside(*parts):
            await stop.wait()
    finally:
        for pump in pumps:
            pump.timer.stop()
            if pump.link is not None:
                pump.link.close()
        if bus is not None:
            await bus.close()


def _awaited(pumps: Sequence[_Pump], bus: ZenohBus) -> list[list[Precondition]]:
    """The preconditions of each: the first for the bus that all share, each for its own pose."""
    poses = [[_awaited_pose(pump)] if pump.config.is_guarded else [] for pump in pumps]
    return [[awaited_bus(pumps[0].config, bus), *poses[0]], *poses[1:]]


def _awaited_pose(pump: _Pump) -> Precondition:
    return awaited_pose(pump.config, lambda: pump.has_pose)


def _core(config: SimulatedDroneConfig, clock: Clock) -> Drone:
    """ConfigError for parameters that are none."""
    try:
        return (GuardedDrone if config.is_guarded else AgentCore)(config, clock.monotonic_ns())
    except ValueError as error:
        raise ConfigError([f"drone-agent: parameters: {error}"]) from error


def _warm_up(cores: Sequence[Drone], airframes: Sequence[Airframe], clock: Clock) -> None:
    """Nothing compiles in flight."""
    share_air(airframes)
    for core in cores:
        core.truth(clock.monotonic_ns())
    warm_up()
