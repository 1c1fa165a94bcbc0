"""The bridge's process: pumps GuardCore between the ground's link, the bus and the autopilot's own port."""

import sys
from math import inf

from drone_agent.guard.config import GuardConfig
from drone_agent.guard.core import GuardCore, datagrams, warm_up
from drone_agent.process import DeadlineTimer, awaited_bus, awaited_pose, drone_protection, open_ground_link
from formation.messages import Datagram, Event, LabFrame, Severity
from wire.clock import REAL_TIME, Clock
from wire.errors import ConfigError
from wire.mavlink.framing import FrameCutter
from wire.process.daemon import READY, EventSink, Precondition, Stop, Watchdog, beside, notify, report_missing
from wire.process.progress import compile_all
from wire.process.system import prefer_process
from wire.rejections import RejectionLog
from wire.security.bus_access import ExposedError
from wire.security.protection import Protection
from wire.transport.link import Link
from wire.transport.mocap_bus import MocapBus
from wire.transport.serial_link import device_and_baud, open_serial
from wire.transport.udp_bus import open_udp_direct
from wire.transport.zenoh_bus import ZenohBus


class BridgeConfig(GuardConfig):
    """One guard in a process of its own, beside a real autopilot."""

    bridge: str
    """The autopilot: udp:HOST:PORT, udpin:HOST:PORT or serial:DEV:BAUD."""


class _Pump:
    """Hands what arrives to the core at once, and wakes it at its own deadlines."""

    def __init__(self, core: GuardCore, sysid: int, report: EventSink, clock: Clock, *, serial: bool) -> None:
        """serial: the autopilot's bytes come as a stream, not as datagrams."""
        self.ground: Link | None = None
        self.autopilot: Link | None = None
        self.rejections = RejectionLog()
        self._core, self._sysid = core, sysid
        self._cutter = FrameCutter(stream=serial)
        self._report = report
        self._clock = clock
        self._watchdog = Watchdog()
        self.timer = DeadlineTimer(self.turn, clock)

    def from_ground(self, datagram: Datagram) -> None:
        """The ground said something."""
        self._core.receive_ground(datagram, self._clock.monotonic_ns())
        self.turn()

    def from_autopilot(self, datagram: Datagram) -> None:
        """The autopilot said something."""
        self._core.receive_autopilot(self._cutter.cut(datagram.data), self._clock.monotonic_ns())
        self.turn()

    def from_mocap(self, frame: LabFrame) -> None:
        """The mocap saw something."""
        self._core.receive_frame(frame, self._clock.monotonic_ns())
        self.turn()

    def turn(self) -> None:
        """Send what is due and sleep until the next deadline."""
        now_ns = self._clock.monotonic_ns()
        out = self._core.tick(now_ns)
        self._watchdog.feed(now_ns)
        to_autopilot = datagrams(self._sysid, [frame.data for frame in out.to_autopilot])
        for link, sent in ((self.autopilot, to_autopilot), (self.ground, out.to_ground)):
            if link is not None:
                for datagram in sent:
                    link.send(datagram)
        for event in (*out.events, *self.rejections.due(now_ns)):
            self._report(event)
        self.timer.at(self._core.due_ns)


async def run_bridge(config: BridgeConfig, report: EventSink, clock: Clock = REAL_TIME) -> None:
    """Be the bridge until SIGINT or SIGTERM.

    Raises OSError where a port cannot be had, ConfigError where `bridge` is no address of an autopilot.
    """
    stop, protection, autopilot = Stop(report), drone_protection(config), config.bridge
    compile_all("drone-agent", warm_up, sys.stderr)
    config = config.model_copy(update={"inertial_rate_hz": min(config.inertial_rate_hz, imu_rate_limit_hz(autopilot))})
    core = GuardCore(config, clock.monotonic_ns())
    pump = _Pump(core, config.sysid, report, clock, serial=autopilot.startswith("serial:"))
    bus: ZenohBus | None = None
    try:
        pump.autopilot = await _open_autopilot(autopilot, config.sysid, pump, protection)
        report(Event(Severity.INFO, f"uav{config.sysid}", f"priority: {prefer_process()}"))
        bus = await ZenohBus.open(config.link, config.lab, pump.rejections, protection)
        MocapBus(bus, clock).on_frame(pump.from_mocap)
        pump.ground = await open_ground_link(config, bus, pump.from_ground, pump.rejections, protection)
        pump.turn()
        notify(READY)
        awaited = (
            awaited_bus(config, bus),
            _awaited_autopilot(autopilot, config.sysid, core),
            awaited_pose(config, lambda: core.has_pose),
        )
        missing = report_missing(f"uav{config.sysid}", awaited, report, bus.others)
        async with beside(missing, protection.attend(report)):
            await stop.wait()
    finally:
        pump.timer.stop()
        for link in (pump.ground, pump.autopilot):
            if link is not None:
                link.close()
        if bus is not None:
            await bus.close()


def _awaited_autopilot(where: str, sysid: int, core: GuardCore) -> Precondition:
    line = "its baud rate" if where.startswith("serial:") else "its port"
    remedy = f"no heartbeat of system {sysid}: is it on, does it send MAVLink here, is {line} the same?"
    return Precondition(f"the autopilot at {where}", lambda: core.has_autopilot, remedy)


def imu_rate_limit_hz(autopilot: str) -> float:
    """How many HIGHRES_IMU a second fill no more than their share of the line; infinite where it is none."""
    try:
        _, baud = device_and_baud(autopilot)
    except ValueError:
        return inf
    return 0.25 * baud / (10 * 75)  # a quarter of the line: ten bits a byte, 75 bytes of HIGHRES_IMU, framed


async def _open_autopilot(text: str, sysid: int, pump: _Pump, protection: Protection) -> Link:
    kind = text.partition(":")[0]
    inner = protection.towards_autopilot(text)
    try:
        if kind == "serial":
            return await open_serial(text, sysid, pump.from_autopilot, inner.channel(sysid))
        if kind in ("udp", "udpin", "udpout"):
            return await open_udp_direct(text, sysid, pump.from_autopilot, pump.rejections, inner)
    except ValueError as error:
        raise ConfigError([f"drone-agent: bridge: {error}"]) from error
    except ExposedError:
        raise
    except OSError as error:
        raise OSError(f"bridge {text}: {error.strerror or error}") from error
    raise ConfigError([f"drone-agent: bridge: {text!r} is not udp:HOST:PORT, udpin:HOST:PORT or serial:DEV:BAUD"])
