"""Frame in, attitude targets out, by the oracles alone: what the whole control stack should say, vehicle by vehicle.

Vehicles begin at rest and are led from there to slots, to points, or along a circle. Imports nothing of the product.
"""

from dataclasses import dataclass

import numpy as np

from tests.formation.oracles.attitude import Airframe, Bounds, Target, Wanted, full_force, target, waiting
from tests.formation.oracles.barriers import Moving, altered, obeyed
from tests.formation.oracles.estimator import Estimate, G, Traits, acceleration, begun, turning, update
from tests.formation.oracles.frames import attitude_matrix, to_lab, to_lead
from tests.formation.oracles.guidance import circle, closing, closing_s, ramped
from tests.formation.oracles.law import Compensator, Demanded, Flight, Motion, Predicted, predict
from tests.formation.oracles.response import SECONDS

IDLE, POINT, SLOT, CIRCLE = "idle", "point", "slot", "circle"


@dataclass(frozen=True)
class Circle:
    """Of radius, about the lab's origin, with a turn on top; start_ns on the control clock."""

    radius: float
    period: float
    laps: int
    yaw_rate: float
    start_ns: int

    def motion(self, t_ns: int, height: float, heading: float) -> Motion:
        ramp = min(3.0, 0.25 * self.period)
        duration = self.laps * self.period + ramp
        t = (t_ns - self.start_ns) * SECONDS
        lap = ramped(t, 2.0 * np.pi / self.period, ramp, duration)
        return circle(
            t, self.radius, lap, height, heading, ramped(t, self.yaw_rate, min(2.0, 0.5 * duration), duration)
        )


@dataclass(frozen=True)
class Task:
    """What a commanded vehicle is to do, from its first frame on; goal: x, y, z, heading in its frame."""

    kind: str
    goal: tuple[float | None, float | None, float | None, float | None] = (None, None, None, None)
    speed: float = 0.5


@dataclass
class Guidance:
    """Where a vehicle is led: to `base`, along what is left of a gap."""

    base: np.ndarray
    gap: np.ndarray
    from_ns: int
    duration_s: float
    airborne: bool
    release_ns: int
    floor: float


@dataclass(frozen=True)
class Apart:
    """How near bodies may come, and how fast vehicles may be."""

    separation: float
    speed: float


@dataclass(frozen=True)
class Told:
    """One tick's outcome: estimates, demands, targets, and references (slot, frame) at the frame's time."""

    known: list[Estimate]
    accelerations: list[np.ndarray]
    turning: list[float]
    demands: list[Demanded]
    targets: list[Target]
    references: list[tuple[Motion, Motion]]


class OracleStack:
    """own: index of each commanded vehicle among the n; leader first; flights, airframes, tasks of the commanded."""

    def __init__(
        self, traits: list[Traits], own: list[int], flights: list[Flight], airframes: list[Airframe], tasks: list[Task],
        bounds: Bounds, apart: Apart, path: Circle | None = None,
    ) -> None:  # fmt: skip
        self.traits, self.own, self.flights, self.airframes = traits, own, flights, airframes
        self.tasks, self.bounds, self.apart, self.path = tasks, bounds, apart, path
        self.leads = 0 if own[0] == 0 else None
        m = len(own)
        self.known: list[Estimate] = []
        self.led: list[Guidance] = []
        self.sent_ns: list[int] = []
        self.sent: list[np.ndarray] = []
        self.memory, self.frozen, self.turn, self.last_ns = np.zeros((m, 3)), [False] * m, np.zeros(len(traits)), 0

    def step(
        self, now_ns: int, t_ns: int, pos: np.ndarray, q: np.ndarray, seen: np.ndarray, hover: np.ndarray,
        felt: np.ndarray | None = None,
    ) -> Told:  # fmt: skip
        first = not self.known
        if first:
            self._begin(t_ns, pos, q, seen)
        else:
            self._observe(t_ns, pos, q, seen, felt)
        motions = [self._motion(n) for n in range(len(self.traits))]
        self._lead(first, t_ns, now_ns, motions)
        dt = 0.0 if first else min((now_ns - self.last_ns) * SECONDS, 0.1)
        law = Compensator(
            self.own, self.leads, self.flights, self.traits, self.known, self._reference,
            [task.kind == SLOT for task in self.tasks], self._predicted,
        )  # fmt: skip
        held_ns = min(now_ns, t_ns + 400_000_000)
        demands = [
            law.demand(i, held_ns, self.memory[i], self.frozen[i], self.led[i].airborne, dt)
            for i in range(len(self.own))
        ]
        kept = self._kept_apart(demands, motions, now_ns)
        targets = [self._target(i, n, demands[i], kept[i], now_ns, float(hover[i])) for i, n in enumerate(self.own)]
        self.sent_ns.append(now_ns)
        self.sent.append(np.array([t.sent for t in targets]))
        self.memory = np.array([d.memory for d in demands])
        self.frozen = [t.bits >= 1 for t in targets]
        self.last_ns = now_ns
        accelerations = [acceleration(k, has) for k, has in zip(self.known, self.traits, strict=True)]
        turns = [turning(k, t) for k, t in zip(self.known, self.turn, strict=True)]
        references = [self._reference(i, t_ns, motions[0]) for i in range(len(self.own))]
        self.turn = np.zeros(len(self.traits))
        self.turn[self.own] = [to_lab(*r)[2, 3] for r in references]
        return Told(self.known, accelerations, turns, demands, targets, references)

    def _begin(self, t_ns: int, pos: np.ndarray, q: np.ndarray, seen: np.ndarray) -> None:
        flies = dict(zip(self.own, [task.kind != IDLE for task in self.tasks], strict=True))
        self.known = [begun(t_ns, pos[n], q[n], flies.get(n, False), bool(seen[n])) for n in range(len(pos))]
        hover = [np.array([0.0, 0.0, G, G]) * flies[n] for n in self.own]
        self.sent_ns, self.sent = [-(1 << 60), t_ns - 10**9], [np.zeros((len(self.own), 4)), np.array(hover)]

    def _observe(self, t_ns: int, pos: np.ndarray, q: np.ndarray, seen: np.ndarray, felt: np.ndarray | None) -> None:
        times, sent = np.array(self.sent_ns), np.array(self.sent)
        for n, (k, has) in enumerate(zip(self.known, self.traits, strict=True)):
            i = self.own.index(n) if n in self.own else None
            mine = sent[:, i] if i is not None else sent[:, 0]
            airborne = i is not None and self.led[i].airborne
            poses = (pos[n], q[n]) if seen[n] else (None, None)
            if seen[n] and k.seen_ns is None:
                k = self.known[n] = begun(k.t_ns, pos[n], q[n], k.lift > 0.0, True)
            on_board = None if felt is None or np.isnan(felt[n]).any() else felt[n]
            update(k, has, t_ns, *poses, airborne, float(self.turn[n]), times, mine, on_board)

    def _motion(self, n: int) -> Motion:
        k, has = self.known[n], self.traits[n]
        out = np.zeros((3, 4))
        out[0, :3], out[1, :3], out[2, :3] = k.pos, k.vel, acceleration(k, has)
        out[:, 3] = k.heading[0], k.heading[1], turning(k, float(self.turn[n]))
        return out

    def _lead(self, first: bool, t_ns: int, now_ns: int, motions: list[Motion]) -> None:
        """At the first frame everybody sets out; who is idle is led where it stands."""
        for i, (task, n) in enumerate(zip(self.tasks, self.own, strict=True)):
            if task.kind == IDLE and not first:
                self.led[i].base, self.led[i].floor = motions[n][0].copy(), float(motions[n][0, 2])
            elif first:
                self.led.append(self._set_out(i, task, motions[n], motions[0], t_ns))
        joined = [led for led, task in zip(self.led, self.tasks, strict=True) if task.kind == SLOT]
        for led in joined if first else ():
            led.duration_s = max(other.duration_s for other in joined)

    def _set_out(self, i: int, task: Task, mine: Motion, lead: Motion, t_ns: int) -> Guidance:
        if task.kind == IDLE:
            return Guidance(mine[0].copy(), np.zeros(4), t_ns, 1.0, False, t_ns, float(mine[0, 2]))
        seen = to_lead(mine, lead)[0] if task.kind == SLOT else mine[0]
        base = np.array([x if goal is None else goal for x, goal in zip(seen, task.goal, strict=True)])
        if task.kind == CIRCLE:
            base = self.path.motion(t_ns, mine[0, 2], mine[0, 3])[0]
        if task.kind == POINT:
            inset = 0.1
            base[:2] = np.clip(base[:2], self.bounds.low[:2] + inset, self.bounds.high[:2] - inset)
            base[2] = min(base[2], self.bounds.high[2] - inset)
        gap = seen - base
        gap[3] = np.angle(np.exp(1j * gap[3]))
        duration = closing_s(gap, task.speed)
        if task.kind == CIRCLE and np.linalg.norm(gap[:3]) > 0.02:
            duration = max(duration, 3.0)
        return Guidance(base, gap, t_ns, duration, True, t_ns, 0.0)  # it flew from the first: the lab's floor

    def _reference(self, i: int, t_ns: int, lead: Motion) -> tuple[Motion, Motion]:
        led, task = self.led[i], self.tasks[i]
        slot = np.zeros((3, 4))
        slot[0] = led.base
        if task.kind == CIRCLE:
            slot = self.path.motion(t_ns, led.base[2], led.base[3])
        slot = slot + closing(led.gap, (t_ns - led.from_ns) * SECONDS, led.duration_s)
        return slot, lead.copy() if task.kind == SLOT else np.zeros((3, 4))

    def _predicted(self, n: int, t_ns: int) -> Predicted:
        times, sent = np.array(self.sent_ns), np.array(self.sent)
        i = self.own.index(n) if n in self.own else None
        mine = None if i is None else sent[:, i]
        return predict(self.known[n], self.traits[n], t_ns, float(self.turn[n]), times, mine)

    def _kept_apart(
        self, demands: list[Demanded], motions: list[Motion], now_ns: int
    ) -> list[tuple[np.ndarray, np.ndarray, int]]:
        """Accelerations, what inverts the lag, and bits, once nobody is too fast or too near."""
        bodies, indices = [], []
        for n, (k, has) in enumerate(zip(self.known, self.traits, strict=True)):
            i = self.own.index(n) if n in self.own else None
            if k.seen_ns is None:
                continue
            indices.append(n)
            if i is not None and self.led[i].airborne:
                out = demands[i]
                unresponsive = bool(abs(k.dist[2]) > 4.0 or k.mismatch > 0.55)
                has_now = np.clip(motions[n][2, :3], -4.0, 4.0) if unresponsive or k.mismatch >= 0.38 else None
                bodies.append(
                    Moving(out.motion[0, :3], out.motion[1, :3], out.acc + k.dist, True, has_now, unresponsive)
                )
            else:
                m, ahead = motions[n], (now_ns - k.t_ns) * SECONDS + has.belief[0]
                bodies.append(Moving(m[0, :3] + ahead * m[1, :3], m[1, :3], np.clip(m[2, :3], -4.0, 4.0), False))
        change, bits = altered(bodies, self.apart.separation, self.apart.speed)
        found = {n: (c, b) for n, c, b in zip(indices, change, bits, strict=True)}
        none = (np.zeros(3), 0)
        return [
            (
                *obeyed(demands[i].acc, demands[i].lead_acc, found.get(n, none)[0], self.bounds.tilt),
                found.get(n, none)[1],
            )
            for i, n in enumerate(self.own)
        ]

    def _target(
        self, i: int, n: int, out: Demanded, kept: tuple[np.ndarray, np.ndarray, int], now_ns: int, hover: float
    ) -> Target:
        body, task, known = self.airframes[i], self.tasks[i], self.known[n]
        full, since_s = full_force(hover, body.curve), (now_ns - self.led[i].release_ns) * SECONDS
        if task.kind == IDLE:
            return Target(attitude_matrix(np.array([0.0, 0.0, 1.0]), out.yaw), np.zeros(3), 0.0, 0, np.zeros(4))
        if not self.led[i].airborne:
            return waiting(body, out.yaw, since_s, full)
        lands = task.kind == POINT and self.led[i].base[2] < self.led[i].floor
        acc, lead_acc, bits = kept
        wanted = Wanted(
            acc, lead_acc, out.acc_rate, out.motion, out.force, out.lift_cos, out.yaw, out.yaw_rate,
            known.strength, known.mismatch, since_s if lands else 0.0, bits,
        )  # fmt: skip
        return target(body, self.bounds, wanted, full)
