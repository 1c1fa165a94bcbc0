"""A room of real processes that flies once and again: what is true of its drones is taken down and judged."""

import asyncio
import json
import math
import os
import signal
from collections.abc import AsyncIterator, Callable, Sequence
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from formation.config import TrajectoryConfig
from formation.messages import OperatorReply, OperatorRequest, Phase, Truth, Verb
from formation.requests import GCS_NAME
from sim.campaign import oracle
from sim.campaign.oracle import Verdict
from sim.fly import Files, Running, operate, running
from sim.ports import private_link
from sim.processes import ProcessDied
from sim.scenario import Scenario, TrueVehicle, load
from sim.script import FLIGHT, Operator, Step
from tools.figures import udp_relay
from wire.clock import Clock
from wire.process.daemon import STARVED
from wire.transport.zenoh_bus import ZenohBus

LinkKind = Literal["zenoh", "udp"]
LINKS: tuple[LinkKind, ...] = ("zenoh", "udp")
HEIGHT_M, RATE_HZ = 1.5, 50.0
SYSIDS = (1, 2, 3)
UP: tuple[Step, ...] = FLIGHT[:3]
LOOK_NS = 10_000_000
START_S, DOWN_S = 60.0, 20.0
ANSWER_S = 5.0
DT_S = 0.01
LEVEL = (1.0, 0.0, 0.0, 0.0, 0.5)


class Hung(RuntimeError):
    """The flight did not come as far as its fault."""


@dataclass(frozen=True, slots=True)
class Setting:
    """Where flights are flown: over which link, behind bridges or not, at which clock; relayed: over a relay."""

    link: LinkKind
    clock: Clock
    bridged: bool = False
    relayed: bool = False
    rate_hz: float = RATE_HZ
    log_folder: Path | None = None
    circle_s: float = 60.0
    height_m: float = HEIGHT_M


class Truths:
    """The true states of all drones since the flight began."""

    def __init__(self) -> None:
        self.rows: dict[int, list[Truth]] = {sysid: [] for sysid in SYSIDS}

    def take(self, truth: Truth) -> None:
        self.rows[truth.sysid].append(truth)

    def forget(self) -> None:
        for rows in self.rows.values():
            rows.clear()

    def armed(self) -> bool:
        """Whether any drone is."""
        return any(rows and rows[-1].armed for rows in self.rows.values())

    def down(self, since_ns: int, sysids: Sequence[int] = SYSIDS) -> bool:
        """Whether these have since been seen on the floor with their motors off."""
        lasts = [self.rows[sysid][-1] for sysid in sysids if self.rows[sysid]]
        return len(lasts) == len(sysids) and all(
            truth.t_ns > since_ns and truth.on_ground and not truth.armed for truth in lasts
        )

    def verdict(self, scenario: Scenario, onset_ns: int, sysids: Sequence[int]) -> tuple[Verdict, oracle.Truth]:
        """The campaign's oracle on these drones, all else taken for good."""
        truth = self._sampled(scenario, onset_ns, sysids)
        return oracle.judge(truth), truth

    def _sampled(self, scenario: Scenario, onset_ns: int, sysids: Sequence[int]) -> oracle.Truth:
        begin_ns = max(self.rows[sysid][0].t_ns for sysid in sysids)
        end_ns = max(self.rows[sysid][-1].t_ns for sysid in sysids)
        t_ns = np.append(np.arange(begin_ns, end_ns, round(DT_S * 1e9)), end_ns)
        shape = (len(t_ns), len(sysids))
        pos, vel = np.zeros((*shape, 3)), np.zeros((*shape, 3))
        up, armed = np.zeros(shape), np.zeros(shape, dtype=bool)
        for i, sysid in enumerate(sysids):
            rows = self.rows[sysid]
            at = np.searchsorted([row.t_ns for row in rows], t_ns, side="right") - 1
            pos[:, i] = np.array([row.pos_lab_m for row in rows])[at]
            vel[:, i] = np.array([row.vel_lab_m_s for row in rows])[at]
            q = np.array([row.q_lab_from_flu for row in rows])[at]
            up[:, i] = 1.0 - 2.0 * (q[:, 1] ** 2 + q[:, 2] ** 2)
            armed[:, i] = np.array([row.armed for row in rows])[at]
        names = {v.sysid: v.body for v in scenario.lab.vehicles}
        fence = scenario.lab.limits.fence
        return oracle.Truth(
            names=tuple(names[sysid] for sysid in sysids), t_s=(t_ns - begin_ns) * 1e-9, pos_m=pos, vel_m_s=vel, up=up,
            armed=armed, thrust=np.ones(shape), command=np.tile(LEVEL, (*shape, 1)),
            command_age_s=np.full(shape, np.nan), gain_low=np.ones(shape), gain_high=np.ones(shape),
            lift_most=np.full(shape, np.inf),
            fence_low_m=np.array(fence.low_m), fence_high_m=np.array(fence.high_m),
            t_onset_s=(onset_ns - begin_ns) * 1e-9,
        )  # fmt: skip


class Room:
    """The processes of one setting; a flight is `take_off`, a fault, `bring_down` or `until` down, a verdict."""

    def __init__(
        self, scenario: Scenario, files: Files, flight: Running, clock: Clock, relay: udp_relay.Relay | None
    ) -> None:
        self.scenario, self.files, self.flight, self.clock, self.relay = scenario, files, flight, clock, relay
        self.truths = Truths()
        self.operator = Operator(UP)
        self.state: dict[str, object] = {}
        """What the ground said of itself last."""
        self.spared = ""
        """The process that may well be starved: it was stopped for longer than a simulator can be late."""
        self._flown = False
        self._asked = 0
        flight.bus.on_truth(self.truths.take)
        flight.bus.on_state(GCS_NAME, lambda text: self.state.update(json.loads(text)))

    @asynccontextmanager
    async def take_off(self, script: tuple[Step, ...] = UP) -> AsyncIterator["asyncio.Task[object]"]:
        """A new ground, if this is not the first flight, whose operator walks through the script meanwhile."""
        if self._flown:
            await self._anew()
        self._flown, self.spared = True, ""
        self.state.clear()
        self.operator = Operator(script)
        bus = await ZenohBus.open(self.scenario.lab.link, self.scenario.lab.name)
        walk = asyncio.create_task(
            operate(bus, self.operator, 300.0, lambda _t_s, _going_on: None, self.clock), name="operator"
        )
        try:
            await self.until(lambda: bool(self.state), math.inf)  # however slowly processes start
            self.truths.forget()
            yield walk
        finally:
            walk.cancel()
            await asyncio.gather(walk, return_exceptions=True)
            await bus.close()

    async def _anew(self) -> None:
        """Another ground, and whatever else has ended."""
        group = self.flight.group
        await group.stop(group.child("gcs"))
        for child in group.children:
            if child.process.returncode is not None:
                await group.again(child.name)

    def kill(self, name: str, number: signal.Signals = signal.SIGKILL) -> int:
        """Send a process a signal; when."""
        os.kill(self.flight.group.child(name).process.pid, number)
        return self.clock.monotonic_ns()

    async def sleep(self, seconds: float) -> None:
        """By the flight's clock."""
        await self.clock.sleep_until_ns(self.clock.monotonic_ns() + round(seconds * 1e9))

    async def until(self, wanted: Callable[[], bool], within_s: float) -> bool:
        """Whether it became true in time. ProcessDied where a simulator is starved meanwhile."""
        begin_ns = self.clock.monotonic_ns()
        while not wanted():
            now_ns = self.clock.monotonic_ns()
            if now_ns - begin_ns > within_s * 1e9:
                return False
            self.look_for_starved()
            await self.clock.sleep_until_ns(now_ns + LOOK_NS)
        return True

    async def until_phase(self, phase: Phase) -> None:
        """Hung where it never comes."""
        if not await self.until(lambda: self.operator.phase is phase, START_S):
            raise Hung(f"never in {phase.name}: {self.whereabouts()}")

    def whereabouts(self) -> str:
        """Where the flight has come to, and what the ground has against more."""
        return f"{self.operator.phase.name}, {self.operator.outcome}, {self.state.get('prearm_failures')}"

    async def bring_down(self, since_ns: int, sysids: Sequence[int]) -> bool:
        """Ask for a landing once a second until all are down; whether they are, in time."""
        for _ in range(round(DOWN_S)):
            asking = asyncio.create_task(self.ask(Verb.LAND))
            if await self.until(lambda: self.truths.down(since_ns, sysids), 1.0):
                asking.cancel()
                return True
            asking.cancel()
        return False

    async def ask(self, verb: Verb) -> OperatorReply:
        """The ground's answer; no answer is one of refusal."""
        self._asked += 1
        request = OperatorRequest(self._asked, verb, "")
        try:
            return await self.flight.bus.ask(GCS_NAME, request, ANSWER_S / self.clock.speed)
        except TimeoutError as error:
            return OperatorReply(self._asked, False, str(error))

    def look_for_starved(self) -> None:
        """ProcessDied where the machine gives a simulator too little time."""
        for child in self.flight.group.children:
            if child.process.returncode == STARVED and child.name != self.spared:
                raise ProcessDied(f"{child.name} starved", starved=True)

    def said(self, name: str) -> str:
        """All that a process has printed."""
        return self.flight.group.child(name).output.read_text(errors="replace")


def scenario_of(setting: Setting) -> Scenario:
    """The paper's triangle on a circle."""
    plain = load("triangle_circle")
    lab = plain.lab
    circle = TrajectoryConfig(kind="circle", radius_m=0.3, period_s=6.0, duration_s=setting.circle_s)
    lab = lab.model_copy(
        update={
            "flight": lab.flight.model_copy(update={"altitude_m": setting.height_m, "climb_m_s": 0.6}),
            "mocap": lab.mocap.model_copy(update={"rate_hz": setting.rate_hz}),
            "leader": lab.leader.model_copy(update={"trajectory": circle}),
        }
    )
    starts = {v.sysid: v.start for v in plain.vehicles}
    vehicles = tuple(TrueVehicle(sysid=k, bridged=setting.bridged, start=starts.get(k)) for k in SYSIDS)
    cameras = plain.mocap.model_copy(update={"rate_hz": setting.rate_hz})
    return plain.model_copy(update={"lab": lab, "vehicles": vehicles, "mocap": cameras, "formation_s": None})


@asynccontextmanager
async def room(setting: Setting, folder: Path, seed: int) -> AsyncIterator[Room]:
    """Its processes, started; all are gone on leaving."""
    folder.mkdir(parents=True, exist_ok=True)
    files, scenario = Files(folder, setting.log_folder), scenario_of(setting)
    async with AsyncExitStack() as stack:
        link = stack.enter_context(private_link(setting.link, SYSIDS))
        scenario = scenario.model_copy(update={"lab": scenario.lab.model_copy(update={"link": link})})
        theirs = relay = None
        if setting.relayed:
            apart = stack.enter_context(private_link("udp", SYSIDS))
            theirs = apart.model_copy(update={"zenoh_connect": link.zenoh_connect})
            relay = stack.enter_context(udp_relay.relay(link, theirs, SYSIDS, seed, setting.clock))
        flight = await stack.enter_async_context(
            running(scenario, seed, files, clock=setting.clock, drones_link=theirs)
        )
        yield Room(scenario, files, flight, setting.clock, relay)
