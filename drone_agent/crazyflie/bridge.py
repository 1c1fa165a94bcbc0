"""The process of Crazyflies: pumps guards and upper halves between the ground's links, the bus and the radio."""

import asyncio
import sys
from collections.abc import Sequence

from drone_agent.crazyflie import core as crazyflie
from drone_agent.crazyflie.core import CrazyflieConfig, CrazyflieCore
from drone_agent.flight.autopilot import Note
from drone_agent.guard.core import GuardCore, warm_up
from drone_agent.guarded import Guarded
from drone_agent.process import DeadlineTimer, awaited_bus, awaited_pose, drone_protection, open_ground_link
from formation.messages import Datagram, Event, LabFrame, Severity
from wire.clock import REAL_TIME, Clock
from wire.process.daemon import READY, EventSink, Precondition, Stop, Watchdog, beside, notify, report_missing
from wire.process.progress import compile_all
from wire.process.system import prefer_process
from wire.rejections import RejectionLog
from wire.transport.crtp_link import CrtpLink, open_crtp
from wire.transport.link import Link
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

_RETRY_S = 1.0


class _Pump:
    """Hands what arrives to one drone at once, and wakes it at its own deadlines."""

    def __init__(self, config: CrazyflieConfig, report: EventSink, clock: Clock, rejections: RejectionLog) -> None:
        now_ns = clock.monotonic_ns()
        self.config = config
        self.drone = Guarded(GuardCore(config, now_ns), CrazyflieCore(config, now_ns))
        self.ground: Link | None = None
        self._vehicle: CrtpLink | None = None
        self._rejections, self._report, self._clock = rejections, report, clock
        self._watchdog = Watchdog()
        self.timer = DeadlineTimer(self.turn, clock)

    def receive(self, datagram: Datagram) -> None:
        """The ground sent something."""
        self.drone.receive(datagram, self._clock.monotonic_ns())
        self.turn()

    def receive_frame(self, frame: LabFrame) -> None:
        """The mocap saw something."""
        self.drone.receive_frame(frame, self._clock.monotonic_ns())
        self.turn()

    def receive_packet(self, data: bytes) -> None:
        """The vehicle sent something."""
        self.drone.autopilot.receive_packet(data, self._clock.monotonic_ns())
        self.turn()

    def turn(self) -> None:
        """Send what is due and sleep until the next deadline."""
        now_ns = self._clock.monotonic_ns()
        out = self.drone.tick(now_ns)
        packets = self.drone.autopilot.pop_packets()
        self._watchdog.feed(now_ns)
        if self._vehicle is not None:
            self.drone.autopilot.crazyflie.sent_again = 1.0 - 0.01 * self._vehicle.quality
            for packet in packets:
                self._vehicle.send(packet)
        if self.ground is not None:
            for datagram in out.datagrams:
                self.ground.send(datagram)
        for event in (*out.events, *self._rejections.due(now_ns)):
            self._report(event)
        self.timer.at(self.drone.due_ns)

    async def maintain_link(self, reported: set[str]) -> None:
        """Open the vehicle's link, and again whenever it is lost. reported: losses of this process, one of each."""
        address, notes = self.config.bridge, self.drone.autopilot.crazyflie.notes
        radio = address.split("/")[2]
        while True:
            what = address
            try:
                link = self._vehicle = await open_crtp(address, self.receive_packet)
                await link.lost.wait()
                why = link.why
                if link.has_received:
                    reported -= {address, radio}
                if link.radio_is_lost:
                    what, why = radio, f"{why}: is it unplugged? The watchdogs of its drones stop their motors"
            except OSError as error:
                what, why = radio, f"{error}: is it plugged in, has another program it?"
            finally:
                if self._vehicle is not None:
                    link, self._vehicle = self._vehicle, None
                    await asyncio.to_thread(link.close)
            if what not in reported:
                reported.add(what)
                notes.append(Note(Severity.CRITICAL, f"link to {what} lost: {why}"))
                self.turn()
            await asyncio.sleep(_RETRY_S)


async def run_crazyflies(configs: Sequence[CrazyflieConfig], report: EventSink, clock: Clock = REAL_TIME) -> None:
    """Be the bridges of one radio until SIGINT or SIGTERM; OSError where a port cannot be had."""
    stop, rejections, protections = Stop(report), RejectionLog(), [drone_protection(config) for config in configs]

    def compile_kernels() -> None:
        warm_up()
        crazyflie.warm_up()

    compile_all("drone-agent", compile_kernels, sys.stderr)
    pumps = [_Pump(config, report, clock, rejections) for config in configs]
    bus: ZenohBus | None = None
    try:
        report(Event(Severity.INFO, "drone-agent", f"priority: {prefer_process()}"))
        bus = await ZenohBus.open(configs[0].link, configs[0].lab, rejections, protections[0])

        def receive_frame(frame: LabFrame) -> None:
            for pump in pumps:
                pump.receive_frame(frame)

        MocapBus(bus, clock).on_frame(receive_frame)
        for pump, protection in zip(pumps, protections, strict=True):
            pump.ground = await open_ground_link(pump.config, bus, pump.receive, rejections, protection)
            pump.turn()
        notify(READY)
        parts, reported = [protection.attend(report) for protection in protections], set[str]()
        for pump in pumps:
            parts += [
                pump.maintain_link(reported),
                report_missing(f"uav{pump.config.sysid}", _awaited(pump, bus), report, bus.others),
            ]
        async with beside(*parts):
            await stop.wait()
    finally:
        for pump in pumps:
            pump.timer.stop()
            if pump.ground is not None:
                pump.ground.close()
        if bus is not None:
            await bus.close()


def _awaited(pump: _Pump, bus: ZenohBus) -> Sequence[Precondition]:
    remedy = "is it switched on, is its address right, has another program the radio?"
    upper = pump.drone.autopilot
    return (
        awaited_bus(pump.config, bus),
        Precondition(f"the Crazyflie at {pump.config.bridge}", lambda: upper.crazyflie.connection is not None, remedy),
        awaited_pose(pump.config, lambda: pump.drone.guards[0].has_pose),
    )
