"""From demanded acceleration to attitude, body rates and thrust within the limits, in vectors. Imports no product."""

from dataclasses import dataclass

import numpy as np

from tests.formation.oracles.estimator import G, doubt
from tests.formation.oracles.frames import attitude_matrix

TILT, LOW, HIGH, FENCE = 1, 2, 4, 16


@dataclass(frozen=True)
class Airframe:
    """What the inversion needs of a vehicle, SI."""

    mass: float
    inertia: tuple[float, float, float]
    wheelbase: float
    curve: float
    lag: float
    attitude_p: float
    yaw_p: float
    rate_p: float
    rate_max: float
    by_rate: bool
    drag: np.ndarray  # over mass, along x, y, z of the lab


@dataclass(frozen=True)
class Bounds:
    tilt: float
    low: np.ndarray
    high: np.ndarray
    margin: float = 0.05


@dataclass(frozen=True)
class Target:
    r: np.ndarray
    rate: np.ndarray
    thrust_norm: float
    bits: int
    sent: np.ndarray


def norm_of(fraction: float, curve: float) -> float:
    """u of (1 - k) u + k u^2 = fraction."""
    if fraction <= 0.0:
        return 0.0
    roots = np.roots([curve, 1.0 - curve, -fraction])
    return float(np.max(roots.real))


def full_force(hover_norm: float, curve: float) -> float:
    """Specific force of full thrust, if hover_norm hovers."""
    u = float(np.clip(hover_norm, 0.05, 0.95))
    return G / ((1.0 - curve) * u + curve * u**2)


def inside(motion: np.ndarray, acc: np.ndarray, bounds: Bounds, lands: bool = False) -> tuple[np.ndarray, int]:
    """No more acceleration towards a wall than lets the vehicle brake with 4 m/s^2; landing, not of the floor."""
    acc, bits = acc.copy(), 0
    for axis in range(3):
        for outward, wall in ((-1.0, bounds.low[axis]), (1.0, bounds.high[axis])):
            if lands and (axis, outward) == (2, -1.0):
                continue
            room = outward * (wall - motion[0, axis]) - bounds.margin
            speed = outward * motion[1, axis]
            if room > 0.0:
                allowed = np.sqrt(2.0 * 4.0 * room)
                most = 4.0 * (allowed - speed) - 4.0 * max(speed, 0.0) / allowed
            else:
                most = 4.0 * (4.0 * room - speed)
            if outward * acc[axis] > most:
                acc[axis], bits = outward * most, FENCE
    return acc, bits


def least_lift(landing_s: float, climb: float, strength: float) -> float:
    """0.45 g; 6 s after its release what lands and sinks keeps all but 1 m/s^2, all of it at 1 m/s of sink."""
    if landing_s < 6.0:
        return 0.45 * G
    kept = [G / strength, (G - 1.0) / strength, (G - 1.0) / strength, 0.45 * G]
    return max(0.45 * G, float(np.interp(climb, [-1.0, -0.5, 0.0, 0.5], kept)))


def bounded(force: np.ndarray, least: float, lift_most: float, tilt: float) -> tuple[np.ndarray, int]:
    """Height before sideways: from the least to 0.88 of the lift, then what tilt and thrust leave."""
    up = float(np.clip(force[2], least, 0.88 * lift_most))
    bits = LOW if force[2] < up else HIGH if force[2] > up else 0
    flat = force[:2]
    most = min(up * np.tan(tilt), np.sqrt(lift_most**2 - up**2))
    size = np.linalg.norm(flat)
    if size > most:
        flat, bits = flat * most / size, bits | TILT
    return np.array([flat[0], flat[1], up]), bits


def turned(force: np.ndarray, now: np.ndarray, authority: float, full: float) -> np.ndarray:
    """Sideways no further from the force of now than the motors' torque can turn."""
    gap = force[:2] - now[:2]
    most = authority * force[2] * max(min(force[2], full - force[2]), 0.0)
    size = np.linalg.norm(gap)
    flat = now[:2] + gap * min(1.0, most / size) if size > 0.0 else force[:2]
    return np.array([flat[0], flat[1], force[2]])


def authority_of(body: Airframe) -> float:
    """rad of attitude error per m/s^2 that asks for torque T/m x arm / J: motors can stop or double."""
    arm = 0.5 * body.wheelbase * np.cos(np.pi / 4.0)
    return float(arm * body.mass / max(body.inertia[:2]) / (body.attitude_p * body.rate_p))


def flat_rates(force: np.ndarray, force_rate: np.ndarray, yaw: float, yaw_rate: float) -> np.ndarray:
    """Body rates of the attitude along a changing force, R^T R' = [w]x by central differences."""
    h = 1e-6
    ahead, behind = (attitude_matrix(force + k * h * force_rate, yaw + k * h * yaw_rate) for k in (1, -1))
    spin = attitude_matrix(force, yaw).T @ (ahead - behind) / (2.0 * h)
    return np.array([spin[2, 1], spin[0, 2], spin[1, 0]])


def waiting(body: Airframe, yaw: float, waited_s: float, full: float) -> Target:
    """On the floor: level, thrust rising until it lifts."""
    lift = G * min(0.2 + 0.9 * waited_s, 1.9)
    r = attitude_matrix(np.array([0.0, 0.0, 1.0]), yaw)
    thrust = norm_of(min(lift / full, 1.0), body.curve)
    return Target(r, np.zeros(3), thrust, 0, np.array([0.0, 0.0, min(lift, full), min(lift, full)]))


@dataclass(frozen=True)
class Wanted:
    """A demand: accelerations, predicted motion and force, heading; and what is known of the vehicle."""

    acc: np.ndarray
    lead_acc: np.ndarray
    acc_rate: np.ndarray
    motion: np.ndarray
    force: np.ndarray
    lift_cos: float
    yaw: float
    yaw_rate: float
    strength: float
    mismatch: float
    landing_s: float = 0.0
    bits: int = 0


def target(body: Airframe, bounds: Bounds, wanted: Wanted, full: float) -> Target:
    """In the air."""
    motion, force, yaw, yaw_rate = wanted.motion, wanted.force, wanted.yaw, wanted.yaw_rate
    acc, wall = inside(motion, wanted.acc, bounds, wanted.landing_s > 0.0)
    aim = (acc + np.array([0.0, 0.0, G]) + body.drag * motion[1, :3]) / wanted.strength
    felt = aim + wanted.lead_acc / wanted.strength
    least = least_lift(wanted.landing_s, motion[1, 2], wanted.strength)
    aim, met = bounded(aim, least, 0.92 * full, bounds.tilt)
    felt, later = bounded(felt, least, 0.92 * full, 1.1 if body.by_rate else bounds.tilt)
    trusted = authority_of(body) * (1.0 - 0.45 * doubt(wanted.mismatch))
    aim, felt = turned(aim, force, trusted, full), turned(felt, force, trusted, full)
    cosine, rate = aim[2] / np.linalg.norm(aim), np.zeros(3)
    # Of what the tilt takes, a loop that is behind_s late asks for phi theta' behind_s by itself: the twist it sees.
    behind_s = 1.0 / body.attitude_p - (body.lag if body.by_rate else 0.0)
    of_tilt = flat_rates(aim, wanted.acc_rate / wanted.strength, yaw, yaw_rate)[2] / cosine - yaw_rate
    turn = yaw_rate + (1.0 - body.yaw_p * behind_s) * of_tilt
    if body.by_rate:
        r = attitude_matrix(np.array([aim[0], aim[1], felt[2]]), yaw)
        rate = flat_rates(aim, body.attitude_p * (felt - aim), yaw, yaw_rate)
        rate = np.clip([*rate[:2], cosine * turn], -body.rate_max, body.rate_max)
    else:
        r = attitude_matrix(felt, yaw + turn / body.yaw_p)
        met = max(met, later)
    lift = min(felt[2] / max(wanted.lift_cos, np.cos(bounds.tilt)), full)
    flat = lift * felt[:2] / np.linalg.norm(felt)
    return Target(r, rate, norm_of(lift / full, body.curve), wanted.bits + wall + met, np.array([*flat, felt[2], lift]))
