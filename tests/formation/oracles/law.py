"""The composite law, Eq. (7), at the time when a command takes hold: predictions, error, demand and lag compensation.

lambda'' = lambda_d'' - c e' - t_m is demanded in the leader's turning frame and carried to the lab by the second
derivative of p = p_L + R lambda; Z3 is taken off. Imports nothing of the product.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tests.formation.oracles.estimator import Estimate, G, Traits, attitude_answer, dist_after, dist_rate, turning
from tests.formation.oracles.frames import rot_z, to_lab, to_lead
from tests.formation.oracles.powers import sig, super_twisting_backward
from tests.formation.oracles.response import SECONDS, answered

Motion = np.ndarray  # (3, 4): position, velocity, acceleration of x, y, z, heading


@dataclass(frozen=True)
class Feedback:
    """What a law makes of the error of one axis: s, t_m, memory, and the acceleration demanded against the error."""

    s: float
    t_m: float
    memory: float
    back: float
    back_rate: float
    takes_off_z3: bool


Law = Callable[[float, float, float, float, float, float], Feedback]
"""(e, e', e'', memory, boost of p1, dt) -> Feedback."""


def sliding(c: float, p1: float, p2: float, eps: float, smooth: float, speed_max: float, z3: bool) -> Law:
    """Eqs. (5)-(7): ISTSMC, and CFC with Z3."""

    def law(e: float, e_rate: float, e_acc: float, memory: float, boost: float, dt: float) -> Feedback:
        e = float(np.clip(e, -speed_max / c, speed_max / c))
        s, s_rate, strong = c * e + e_rate, c * e_rate + e_acc, boost * p1
        t_m, grown = super_twisting_backward(s, memory, strong, p2, eps, smooth, dt)
        t_rate = 0.0
        if smooth > 0.0:
            h = 1e-5 * max(abs(s), smooth)
            slope = (sig(s + h, 1 + eps, smooth) - sig(s - h, 1 + eps, smooth)) / (2.0 * h)
            t_rate = strong * slope * s_rate + p2 * sig(s, 1.0 + 2.0 * eps, smooth)
        return Feedback(s, t_m, grown, -c * e_rate - t_m, -c * e_acc - t_rate, z3)

    return law


def smc(c: float, k: float, speed_max: float) -> Law:
    """The baseline: t_m = k sign(s)."""

    def law(e: float, e_rate: float, e_acc: float, memory: float, boost: float, dt: float) -> Feedback:
        s = c * float(np.clip(e, -speed_max / c, speed_max / c)) + e_rate
        t_m = k * float(np.sign(s))
        return Feedback(s, t_m, memory, -c * e_rate - t_m, -c * e_acc, False)

    return law


def cascade(kp_position: float, kp: float, ki: float, kd: float, speed_max: float) -> Law:
    """The double loop: a velocity error v = e' + kp_position e, then -kp v - ki int v - kd v'."""

    def law(e: float, e_rate: float, e_acc: float, memory: float, boost: float, dt: float) -> Feedback:
        e = float(np.clip(e, -speed_max / kp_position, speed_max / kp_position))
        v, v_rate = e_rate + kp_position * e, e_acc + kp_position * e_rate
        memory = memory + ki * v * dt
        back = -kp * v - memory - kd * v_rate
        return Feedback(v, -back, memory, back, -kp * v_rate - ki * v, False)

    return law


def geometric(kx: float, kv: float, ki: float, mix: float, bound: float, speed_max: float) -> Law:
    """Goodarzi, Lee, Lee (2013): -kx e - kv e' - ki sat(int(e' + mix e))."""

    def law(e: float, e_rate: float, e_acc: float, memory: float, boost: float, dt: float) -> Feedback:
        e = float(np.clip(e, -speed_max * kv / kx, speed_max * kv / kx))
        memory = float(np.clip(memory + dt * (e_rate + mix * e), -bound, bound))
        back = -kx * e - kv * e_rate - ki * memory
        return Feedback(
            mix * e + e_rate, -back, memory, back, -kx * e_rate - kv * e_acc - ki * (e_rate + mix * e), False
        )

    return law


@dataclass(frozen=True)
class Quick:
    """Lag compensation: share of the rate, gain on what is missed, powers of mu on it and on p1, the leader's share."""

    rate: float = 1.0
    gain: float = 1.0
    gain_power: float = 0.0
    p1_power: float = 0.0
    lead_share: float = 0.0


@dataclass(frozen=True)
class Flight:
    """What of a commanded vehicle the law is told."""

    horizontal: Law
    vertical: Law
    compensate: bool
    quick: Quick
    turn_dead_s: float


@dataclass(frozen=True)
class Predicted:
    """A motion and the specific force at some time."""

    motion: Motion
    force: np.ndarray


@dataclass
class Demanded:
    """What the law asks of one vehicle."""

    e: np.ndarray
    e_rate: np.ndarray
    s: np.ndarray
    t_m: np.ndarray
    memory: np.ndarray
    acc: np.ndarray
    lead_acc: np.ndarray
    acc_rate: np.ndarray
    motion: Motion
    force: np.ndarray
    lift_cos: float
    yaw: float
    yaw_rate: float


def predict(
    k: Estimate, has: Traits, to_ns: int, turn: float, sent_ns: np.ndarray, sent: np.ndarray | None
) -> Predicted:
    """Newton's law: commanded vehicles answer what they were sent; observed ones go on tilting, ever slower."""
    h = (to_ns - k.t_ns) * SECONDS
    force, speed, travel = k.force.copy(), np.zeros(3), np.zeros(3)
    steady = k.dist.copy()
    if sent is not None:
        flat = answered(sent_ns, sent[:, :2], k.t_ns, to_ns, *attitude_answer(k, has), k.force[:2])
        up = answered(sent_ns, sent[:, 2:3], k.t_ns, to_ns, *has.thrust, k.force[2:])
        force, speed, travel = (np.concatenate(pair) for pair in zip(flat, up, strict=True))
        steady[2] -= G
    else:
        d = has.tilt_decay
        once = (1.0 - np.exp(-d * h)) / d
        twice = (h - once) / d
        thrice = (0.5 * h**2 - twice) / d
        force = k.force + k.force_rate * once
        speed, travel = k.force * h + k.force_rate * twice, 0.5 * k.force * h**2 + k.force_rate * thrice
    motion = np.zeros((3, 4))
    rises = 0.1 * dist_rate(k, has)  # in the end, by exp(-t / 0.1)
    twice = h - 0.1 * (1.0 - np.exp(-10.0 * h))
    pushed, swept = h * steady + rises * twice, 0.5 * h**2 * steady + rises * (0.5 * h**2 - 0.1 * twice)
    moved = (h * k.vel + k.strength * travel + swept) / (1.0 + 0.5 * h * has.drag)  # trapezoid of v'
    motion[0, :3] = k.pos + moved
    motion[1, :3] = k.vel + k.strength * speed + pushed - has.drag * moved
    steady = steady + dist_after(k, has, h) - k.dist
    motion[2, :3] = k.strength * force + steady - has.drag * motion[1, :3]
    alpha = turning(k, turn)
    motion[:, 3] = k.heading[0] + h * k.heading[1] + 0.5 * h**2 * alpha, k.heading[1] + h * alpha, alpha
    return Predicted(motion, force)


def eq_7(slot: Motion, frame: Motion, e: Motion, back: np.ndarray) -> np.ndarray:
    """Lab acceleration of lambda'' = lambda_d'' + back where the vehicle is, e off its slot, in the turning frame."""
    there = slot + e
    there[2, :3] = slot[2, :3] + back
    return to_lab(there, frame)[2, :3]


class Compensator:
    """Eq. (7) with dead time and lag, for the vehicles of one tick.

    own: each commanded vehicle's place among the n; reference(i, t_ns, lead) -> (slot, frame) motions of vehicle i;
    predicted(n, t_ns) -> Predicted.
    """

    def __init__(
        self, own: list[int], leads: int | None, flights: list[Flight], traits: list[Traits], known: list[Estimate],
        reference: Callable[[int, int, Motion], tuple[Motion, Motion]], in_slot: list[bool],
        predicted: Callable[[int, int], Predicted],
    ) -> None:  # fmt: skip
        self.own, self.leads, self.flights, self.traits, self.known = own, leads, flights, traits, known
        self.reference, self.in_slot, self.predicted = reference, in_slot, predicted

    def lab_reference(self, i: int, t_ns: int, lead: Motion) -> Motion:
        slot, frame = self.reference(i, t_ns, lead)
        return to_lab(slot, frame)

    def leader_at(self, hold_ns: int, half_ns: int, compensate: bool) -> tuple[Motion, Motion, Motion]:
        """The leader then, and so much earlier and later: one we command accelerates as its reference says."""
        now = self.predicted(0, hold_ns).motion.copy()
        if self.leads is None or not compensate:
            return now, *(self.predicted(0, hold_ns + k * half_ns).motion for k in (-1, 1))
        earlier, here, later = (self.lab_reference(self.leads, hold_ns + k * half_ns, now) for k in (-1, 0, 1))
        before, after = now + earlier - here, now + later - here
        now[2], before[2], after[2] = here[2], earlier[2], later[2]
        return now, before, after

    def demand(self, i: int, now_ns: int, memory: np.ndarray, frozen: bool, airborne: bool, dt: float) -> Demanded:
        n, flight = self.own[i], self.flights[i]
        known, has = self.known[n], self.traits[n]
        out = Demanded(*(np.zeros(3) for _ in range(8)), np.zeros((3, 4)), np.zeros(3), 1.0, 0.0, 0.0)
        turned_ns = now_ns + int(flight.turn_dead_s * 1e9)
        facing = self.lab_reference(i, turned_ns, self.predicted(0, turned_ns).motion)
        out.yaw, out.yaw_rate = facing[0, 3], facing[1, 3]
        mu = known.mu
        if self.in_slot[i] and self.leads is None:
            mu = max(mu, self.known[0].mu ** flight.quick.lead_share)
        for axes, law, (dead, lag), compensate in (
            ([0, 1], flight.horizontal, attitude_answer(known, has), flight.compensate),
            ([2], flight.vertical, has.thrust, True),
        ):
            arrival_ns = now_ns + int(dead * 1e9)
            hold_ns = arrival_ns if compensate else known.t_ns
            half_ns, caught_up_ns = int(lag * 1e9) // 2, hold_ns + int(lag * 1e9)
            lead, lead_before, lead_after = self.leader_at(hold_ns, half_ns, compensate)
            mine = self.predicted(n, hold_ns)
            slot, frame = self.reference(i, hold_ns, lead)
            error = to_lead(mine.motion, frame) - slot
            boost = mu**flight.quick.p1_power if axes == [0, 1] else 1.0
            back, back_rate = np.zeros(3), np.zeros(3)
            for a in axes:
                fed = law(error[0, a], error[1, a], error[2, a], memory[a], boost, dt)
                out.e[a], out.e_rate[a], out.s[a], out.t_m[a] = error[0, a], error[1, a], fed.s, fed.t_m
                back[a], back_rate[a] = fed.back, fed.back_rate
                kept = memory[a] if frozen and abs(fed.memory) > abs(memory[a]) else fed.memory
                out.memory[a] = kept if airborne else 0.0
            dist, later = (dist_after(known, has, (t - known.t_ns) * SECONDS) for t in (hold_ns, caught_up_ns))
            acc = eq_7(slot, frame, error, back) - (dist if fed.takes_off_z3 else 0.0)
            if axes == [0, 1]:
                acc[:2] *= min(1.0, 11.7 / max(np.linalg.norm(acc[:2]), 1e-9))
            lead_acc = np.zeros(3)
            if compensate:
                change = self.lab_reference(i, hold_ns + half_ns, lead_after)
                change = change - self.lab_reference(i, hold_ns - half_ns, lead_before)
                out.acc_rate[axes] = (change[2, :3] + has.drag * change[1, :3])[axes] / lag
                rising = lag * out.acc_rate - (later - dist if fed.takes_off_z3 else 0.0)
                missing = acc - (mine.motion[2, :3] - dist)
                pull = flight.quick.gain * mu**flight.quick.gain_power - 1.0 if axes == [0, 1] else 0.0
                lead_acc = rising + lag * flight.quick.rate * (rot_z(frame[0, 3]) @ back_rate) + pull * missing
            if axes == [0, 1]:
                out.motion = mine.motion.copy()
                out.force = (mine if compensate else self.predicted(n, arrival_ns)).force
            else:
                out.motion[:, 2] = mine.motion[:, 2]
                size = np.linalg.norm(mine.force)
                out.lift_cos = mine.force[2] / size if size > 1.0 else 1.0
            out.acc[axes], out.lead_acc[axes] = acc[axes], lead_acc[axes]
        return out
