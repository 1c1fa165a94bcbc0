"""The emulated cameras as a process: true poses from the bus in, what the cameras see of them out, in real time.

Out by the lab's own bus, or by a vendor's protocol where the lab's source is a camera system.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from formation.exposure import TOOL
from formation.messages import Event, RawFrame, Severity, Truth
from formation.safety.phases import AIRBORNE
from sim.cameras.emulator import MocapEmulator
from sim.cameras.servers.server import Server
from sim.cameras.systems import is_camera_system, server_for
from sim.scenario import Scenario, recorded_leader
from sim.script import OperatorView
from wire.clock import Clock
from wire.ground_state import decode
from wire.process.daemon import Precondition, Punctuality, beside, report_missing
from wire.process.program import print_event
from wire.security.protection import lab_protection
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

_DRONE = "`drone-agent --config FILE` with pose = 'mocap' and truth_rate_hz = 250"


async def serve(scenario: Scenario, seed: int, gcs_name: str, clock: Clock) -> None:
    """Publish frames for ever, as the hub of the lab's bus (BusError, OSError where an address is taken).

    A recorded leader sets out when the ground `gcs_name` says that the formation stands. StarvedError where, in
    flight, an exposure comes too late.
    """
    link, protection = scenario.lab.link, lab_protection(scenario.lab.security, Path(), TOOL)
    emulator = MocapEmulator(scenario.mocap, scenario.lab, recorded_leader(scenario), seed, clock.monotonic_ns())
    truths: dict[int, Truth] = {}
    punctual, flying = Punctuality("the mocap emulator", "its exposure"), False

    def receive_truth(truth: Truth) -> None:
        truths[truth.sysid] = truth

    def receive_state(text: str) -> None:
        nonlocal flying
        view = OperatorView.at(decode(text))
        flying = view.phase in AIRBORNE
        if view.formed:
            emulator.start(clock.monotonic_ns())

    if link.names_bus:
        bus = await ZenohBus.open(link.listening, scenario.lab.name, protection=protection)
    else:
        bus = await ZenohBus.open_or_listen(link, scenario.lab.name, protection=protection)
    drones = Precondition("true poses of simulated drones", lambda: bool(truths), f"start one: {_DRONE}")
    try:
        bus.on_truth(receive_truth)
        bus.on_state(gcs_name, receive_state)
        missing = report_missing("mocap emulator", [drones], print_event, bus.others)
        async with beside(missing), _outlet(scenario, bus, clock) as server:
            bodies, mocap = ", ".join(v.body for v in scenario.lab.vehicles), scenario.lab.mocap
            where = f"the bus of lab {bus.lab!r}" if isinstance(server, _OnTheBus) else f"{mocap.source}'s protocol"
            text = f"publishing {bodies} at {scenario.mocap.rate_hz:g} Hz on {where}"
            print_event(Event(Severity.INFO, "mocap emulator", text))
            serving = True
            emulator.skip_to(clock.monotonic_ns())
            while True:
                await asyncio.sleep(0.0)  # also where the time has passed: the server's clients are to be heard
                await clock.sleep_until_ns(min(emulator.next_photo_ns, emulator.next_frame_ns))
                now_ns = clock.monotonic_ns()
                if flying:
                    punctual.check(emulator.next_photo_ns, now_ns)
                if serving == emulator.is_dark(now_ns):
                    serving = not serving
                    await (server.start() if serving else server.close())
                for frame in emulator.pop_due(now_ns):
                    if serving:
                        server.publish(frame)
                while emulator.next_photo_ns <= now_ns:
                    emulator.expose(truths)
    finally:
        await bus.close()


@asynccontextmanager
async def _outlet(scenario: Scenario, bus: ZenohBus, clock: Clock) -> AsyncIterator[Server]:
    """Where frames go, started: a vendor's server, or the bus."""
    lab = scenario.lab
    if is_camera_system(lab.mocap):
        server: Server = server_for(lab.mocap, tuple(v.body for v in lab.vehicles), clock)
    else:
        server = _OnTheBus(MocapBus(bus, clock))
    await server.start()
    try:
        yield server
    finally:
        await server.close()


class _OnTheBus:
    """Frames as RawFrame; there is nothing to start."""

    def __init__(self, bus: MocapBus) -> None:
        self._bus = bus

    async def start(self) -> None:
        """It is there."""

    def publish(self, frame: RawFrame) -> None:
        """To the mocap process."""
        self._bus.publish_raw(frame)

    async def close(self) -> None:
        """The bus is not ours."""
