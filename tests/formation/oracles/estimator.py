"""The observers of one vehicle, frame by frame, in vectors and matrices; one object a vehicle, nothing batched.

FTESO after Eqs. (3)-(4), the parabola of the noise by Vandermonde's system, the heading as an angle of a matrix. The
numbers are those that the documentation and the design state. Imports nothing of the product.
"""

from dataclasses import dataclass, field

import numpy as np

from tests.formation.oracles.frames import heading_of, rotation_matrix
from tests.formation.oracles.powers import fteso_backward
from tests.formation.oracles.response import answered

G = 9.8
SECONDS = 1e-9


@dataclass(frozen=True)
class Observer:
    """w, a, e0 and rounding of Eqs. (3)-(4)."""

    w: float
    a: float
    e0: float
    smooth: float


@dataclass(frozen=True)
class Adaptive:
    """The innovation-adaptive gain: filter, threshold in noise, bound, of observed vehicles."""

    lag_s: float
    threshold: float
    most: float


@dataclass(frozen=True)
class Second:
    """A fast observer beside the first: w, thresholds in noise, trust in the tilt, the gain where believed, memory."""

    w: float
    sigmas: tuple[float, float, float]
    attitude_trust: float
    urgency: float
    hold_s: float


@dataclass(frozen=True)
class Traits:
    """What the observers are told of one vehicle."""

    commanded: bool
    horizontal: Observer
    vertical: Observer
    heading: Observer
    attitude: tuple[float, float]  # dead time and lag that are counted on, s
    thrust: tuple[float, float]
    belief: tuple[float, float]  # dead time and lag in full
    adaptive: Adaptive
    second: Second
    second_heading: Second
    shift_most_s: float
    strength_lag_s: float
    attitude_trust: float
    tilt_w: float
    tilt_decay: float
    quiet_m: float
    quiet_rad: float
    drag: np.ndarray  # over mass, along x, y, z of the lab


@dataclass
class Estimate:
    """What is remembered of one vehicle."""

    t_ns: int
    pos: np.ndarray
    r: np.ndarray
    heading: np.ndarray
    seen_ns: int | None
    vel: np.ndarray = field(default_factory=lambda: np.zeros(3))
    dist: np.ndarray = field(default_factory=lambda: np.zeros(3))
    dist_late: np.ndarray = field(default_factory=lambda: np.zeros(2))  # low-passed
    force: np.ndarray = field(default_factory=lambda: np.zeros(3))
    force_rate: np.ndarray = field(default_factory=lambda: np.zeros(3))
    lift: float = 0.0
    strength: float = 1.0
    tilt: np.ndarray = field(default_factory=lambda: np.zeros(2))
    tilt_rate: np.ndarray = field(default_factory=lambda: np.zeros(2))
    innovation: np.ndarray = field(default_factory=lambda: np.zeros(3))
    mu: float = 1.0
    fast_weight: float = 0.0
    felt_ratio: float = 0.0  # how far beyond noise the accelerometer was, lately
    felt_bias: np.ndarray = field(default_factory=lambda: np.zeros(2))
    felt_var: float = 0.3**2
    fast: np.ndarray = field(default_factory=lambda: np.zeros((3, 2)))  # what the fast observer has more than the slow
    side: np.ndarray = field(default_factory=lambda: np.zeros(2))  # to which they were apart last, fading
    turns: np.ndarray = field(default_factory=lambda: np.zeros(2))  # how often that changed of late
    turn_ratio: float = 0.0  # how far beyond noise the fast observer of the heading was, lately
    fast_heading: np.ndarray = field(default_factory=lambda: np.zeros(3))
    noise_m2: float = 2e-4**2
    noise_rad2: float = 1e-3**2
    recent: list[tuple[int, np.ndarray]] = field(default_factory=list)
    believed: np.ndarray = field(default_factory=lambda: np.zeros(2))
    trim: np.ndarray = field(default_factory=lambda: np.zeros(2))
    moments: np.ndarray = field(default_factory=lambda: np.zeros(3))
    slow: np.ndarray = field(default_factory=lambda: np.zeros((2, 2)))  # low-passed rate and miss
    slow_moments: np.ndarray = field(default_factory=lambda: np.zeros(2))
    mismatch: float = 0.0
    shift_s: float = 0.0


def begun(t_ns: int, pos: np.ndarray, q: np.ndarray, hovers: bool, seen: bool) -> Estimate:
    """At rest where the first frame has it."""
    r = rotation_matrix(q)
    known = Estimate(t_ns, pos.copy(), r, np.array([heading_of(r), 0.0, 0.0]), t_ns if seen else None)
    if hovers:
        known.force, known.lift = np.array([0.0, 0.0, G]), G
    return known


def share(dt: float, lag: float) -> float:
    """Of the way that a first-order filter goes in dt."""
    return 1.0 - np.exp(-dt / lag)


def attitude_answer(k: Estimate, has: Traits) -> tuple[float, float]:
    """Dead time, as far as it was seen to be shifted, and lag of the attitude, s."""
    return max(has.attitude[0] - k.shift_s, 0.0), has.attitude[1]


def doubt(mismatch: float) -> float:
    """0 up to a mismatch of 0.45, 1 from 0.55 on."""
    return float(np.clip((mismatch - 0.45) / 0.1, 0.0, 1.0))


def update(
    k: Estimate, has: Traits, t_ns: int, pos: np.ndarray | None, q: np.ndarray | None, airborne: bool, turn: float,
    sent_ns: np.ndarray, sent: np.ndarray, felt: np.ndarray | None = None,
) -> None:  # fmt: skip
    """One frame; pos and q are None where the body is not seen; sent (h, 4): its own commands; felt (3): on board."""
    from_ns, dt = k.t_ns, (t_ns - k.t_ns) * SECONDS
    k.t_ns = t_ns
    seen, r_before = pos is not None, k.r
    if seen:
        k.r, k.seen_ns = rotation_matrix(q), t_ns
    before = k.force.copy()
    if has.commanded:
        _delivered(k, has, from_ns, t_ns, seen, sent_ns, sent)
        if airborne:
            _mismatch(k, has, from_ns, t_ns, seen, sent_ns, sent)
    elif has.tilt_w > 0.0:
        _observed_force(k, has, seen, dt)
    model = k.strength * 0.5 * (before + k.force) - has.drag * k.vel
    if has.commanded:
        model[2] -= G
        if not airborne:
            model[2] = max(model[2], 0.0)
    if seen and airborne and has.second.w > 0.0:
        _felt(k, has, 0.5 * (r_before + k.r), felt, dt)
    if seen:
        _noise(k, t_ns, pos)
        if not has.commanded:
            _adapt(k, has, pos, model, dt)
    two = seen and has.commanded and has.second.w > 0.0
    if two:
        _both(k, has, pos, model, dt)
    for axis in range(2 if two else 0, 3):
        gains = has.horizontal if axis < 2 else has.vertical
        z = np.array([k.pos[axis], k.vel[axis], k.dist[axis]])
        if seen:
            w = gains.w * min(has.quiet_m / np.sqrt(k.noise_m2), 1.0) ** (1.0 / 3.0)
            if not has.commanded:
                w *= k.mu
            elif axis == 2:
                w *= height_gain(k, pos[2], model[2], dt)
            z = fteso_backward(z, pos[axis], model[axis], dt, w, gains.a, gains.e0, gains.smooth)
        else:
            z = np.array(
                [z[0] + dt * z[1] + 0.5 * dt**2 * (model[axis] + z[2]), z[1] + dt * (model[axis] + z[2]), z[2]]
            )
        k.pos[axis], k.vel[axis], k.dist[axis] = z
    k.dist = np.clip(k.dist, -14.0, 14.0)
    k.dist_late = k.dist_late + (1.0 - np.exp(-dt * has.second.w / 5.0)) * (k.dist[:2] - k.dist_late)
    if has.commanded and airborne and seen and k.force[2] > 0.3 * G:
        was = k.strength
        k.strength = float(np.clip(was + dt / (has.strength_lag_s + dt) * k.dist[2] / k.force[2], 0.5, 2.0))
        k.dist = k.dist + (was - k.strength) * k.force
    _heading(k, has, seen, dt, turn)


def _delivered(
    k: Estimate, has: Traits, from_ns: int, to_ns: int, seen: bool, sent_ns: np.ndarray, sent: np.ndarray
) -> None:
    """Thrust delivered by the lag's model, along the measured body z; sideways between model and measurement."""
    flat, _, _ = answered(sent_ns, sent[:, :2], from_ns, to_ns, *attitude_answer(k, has), k.force[:2])
    (up, k.lift), _, _ = answered(sent_ns, sent[:, 2:], from_ns, to_ns, *has.thrust, np.array([k.force[2], k.lift]))
    if seen:
        thrust = k.lift * k.r[:, 2]
        trust = (1.0 - k.fast_weight) * has.attitude_trust + k.fast_weight * has.second.attitude_trust
        flat = (1.0 - trust) * flat + trust * (thrust[:2] - k.trim)
        up = thrust[2]
    k.force = np.array([flat[0], flat[1], up])


def _mismatch(
    k: Estimate, has: Traits, from_ns: int, to_ns: int, seen: bool, sent_ns: np.ndarray, sent: np.ndarray
) -> None:
    """Least squares of what the measured force misses of the believed one on that one's rate: a shift, and the rest."""
    was, dt = k.believed, (to_ns - from_ns) * SECONDS
    k.believed, _, _ = answered(sent_ns, sent[:, :2], from_ns, to_ns, *has.belief, was)
    if not seen:
        return
    rate = (k.believed - was) / dt
    miss = k.lift * k.r[:2, 2] - k.believed
    calm = 1.0 / (1.0 + np.maximum(k.moments[0], rate**2) / 3.0**2)
    learned = np.clip(k.trim + calm * share(dt, 0.5) * (miss - k.trim), -1.0, 1.0)
    k.force[:2] -= learned - k.trim
    k.dist[:2] += k.strength * (learned - k.trim)
    k.trim, miss = learned, miss - learned
    k.moments = k.moments + share(dt, 2.0) * (np.array([rate @ rate, miss @ miss, rate @ miss]) - k.moments)
    turned, length = k.moments[0] + 3.0**2, sum(has.belief)
    slope = k.moments[2] / turned
    k.mismatch = np.sqrt(max(k.moments[1] / turned - slope**2, 0.0)) / length
    k.slow = k.slow + share(dt, length) * (np.array([rate, miss]) - k.slow)
    slow_rate, slow_miss = k.slow
    new = np.array([slow_rate @ slow_rate, slow_miss @ slow_rate])
    k.slow_moments = k.slow_moments + share(dt, 4.0) * (new - k.slow_moments)
    most = (1.0 - doubt(k.mismatch)) * has.shift_most_s
    k.shift_s = float(np.clip(k.slow_moments[1] / (k.slow_moments[0] + 0.25**2), -most, most))


def _observed_force(k: Estimate, has: Traits, seen: bool, dt: float) -> None:
    """Of a vehicle that is only observed: tilt times gravity and its own rise, by an alpha-beta filter."""
    lift = max(G + k.dist[2], 0.0)
    z_b = k.r[:, 2]
    w = has.tilt_w * k.mu
    if seen:
        pole = np.exp(-w * dt)
        ahead = k.tilt + dt * k.tilt_rate
        miss = z_b[:2] / max(z_b[2], 0.3) - ahead
        k.tilt = ahead + (1.0 - pole**2) * miss
        k.tilt_rate = (k.tilt_rate + (1.0 - pole) ** 2 / dt * miss) * np.exp(-has.tilt_decay * dt)
    k.force = np.array([*(lift * k.tilt), k.force[2]])
    k.force_rate = np.array([*(lift * k.tilt_rate), 0.0])


def _noise(k: Estimate, t_ns: int, pos: np.ndarray) -> None:
    """Variances of position and heading from what the parabola through the last three misses of the next."""
    seen = np.append(pos, k.heading[0] + np.angle(np.exp(1j * (heading_of(k.r) - k.heading[0]))))
    if len(k.recent) == 3 and (t_ns - k.recent[0][0]) * SECONDS < 0.2:
        times = np.array([(t - t_ns) * SECONDS for t, _ in k.recent])
        weights = np.linalg.solve(np.vander(times, 3, increasing=True).T, [1.0, 0.0, 0.0])
        squares = (seen - weights @ np.array([p for _, p in k.recent])) ** 2 / (1.0 + weights @ weights)
        gain = min(-times[0] / 1.5, 1.0)
        k.noise_m2 += gain * (min(squares[:3].mean(), 9.0 * k.noise_m2) - k.noise_m2)
        k.noise_m2 = max(k.noise_m2, 2e-5**2)
        k.noise_rad2 += gain * (min(squares[3], 9.0 * k.noise_rad2) - k.noise_rad2)
        k.noise_rad2 = max(k.noise_rad2, 1e-4**2)
    k.recent = [*k.recent, (t_ns, seen)][-3:]


def _felt(k: Estimate, has: Traits, r: np.ndarray, felt: np.ndarray | None, dt: float) -> None:
    """The fast observer's Z3 goes over to what is felt besides thrust and drag, as far as it is no noise."""
    k.felt_ratio *= np.exp(-dt / 0.025)
    if felt is None:
        return
    push = (r @ (felt - np.array([0.0, 0.0, k.strength * k.lift])) + has.drag * k.vel)[:2] - k.felt_bias
    miss = np.clip(push, -14.0, 14.0) - (k.dist[:2] - k.fast_weight * k.fast[2])
    k.felt_ratio = max(k.felt_ratio, float(miss @ miss) / (4.5**2 * k.felt_var))
    fast_weight = k.felt_ratio**4 / (1.0 + k.felt_ratio**4)
    change = fast_weight * (miss - k.fast[2])
    k.fast[2] += change
    k.dist[:2] += k.fast_weight * change
    k.felt_bias = k.felt_bias + (1.0 - 0.75 * fast_weight) * share(dt, 2.0) * miss
    var = k.felt_var + (1.0 - fast_weight) * share(dt, 2.0) * (0.5 * float(miss @ miss) - k.felt_var)
    k.felt_var = float(np.clip(var, 0.05**2, 1.5**2))


def _both(k: Estimate, has: Traits, pos: np.ndarray, model: np.ndarray, dt: float) -> None:
    """A slow and a fast observer of x and y; the estimate goes from the one to the other by r^4 / (1 + r^4)."""
    gains, second = has.horizontal, has.second
    noise = np.sqrt(k.noise_m2)
    calm = min(has.quiet_m / noise, 1.0) ** (1.0 / 3.0)
    states = np.array([k.pos[:2], k.vel[:2], k.dist[:2]]) - k.fast_weight * k.fast
    stepped = [
        np.transpose(
            [
                fteso_backward(z[:, axis], pos[axis], model[axis], dt, w * calm, gains.a, gains.e0, gains.smooth)
                for axis in range(2)
            ]
        )
        for z, w in ((states, gains.w), (states + k.fast, second.w))
    ]
    k.fast = stepped[1] - stepped[0]
    w = second.w * calm
    seen_by_noise = noise * np.sqrt(min(w * dt, 1.0)) * np.array(second.sigmas) * w ** np.arange(3)
    r4 = max(np.max(np.linalg.norm(k.fast, axis=1) / seen_by_noise), k.felt_ratio) ** 4
    fades, apart = np.exp(-dt / 0.5), k.fast[0] / seen_by_noise[0]
    sided = np.abs(apart) > 0.5
    k.turns = fades * k.turns + np.where(sided, np.maximum(-np.sign(apart) * fades * k.side, 0.0), 0.0)
    k.side = np.where(sided, np.sign(apart), fades * k.side)
    k.fast_weight = r4 / (1.0 + r4) / (1.0 + (np.max(k.turns) / 2.0) ** 8)
    k.mu = 1.0 + k.fast_weight * (second.urgency - 1.0)
    k.pos[:2], k.vel[:2], k.dist[:2] = stepped[0] + k.fast_weight * k.fast


def height_gain(k: Estimate, height: float, model: float, dt: float) -> float:
    """1 to 3, by how far the height that is commanded is from where the model has it: over 5 mm and 6 sigmas."""
    ahead = k.pos[2] + dt * k.vel[2] + 0.5 * dt**2 * (model + k.dist[2])
    k.innovation[2] += share(dt, 0.03) * (height - ahead - k.innovation[2])
    sigmas = 6.0 * np.sqrt(k.noise_m2 * dt / (0.06 + dt))
    return float(np.clip(abs(k.innovation[2]) / max(0.005, sigmas), 1.0, 3.0))


def _adapt(k: Estimate, has: Traits, pos: np.ndarray, model: np.ndarray, dt: float) -> None:
    """mu = sqrt(1 + innovation^2 / expected^2) of an observed vehicle: one for all three axes."""
    ahead = k.pos + dt * k.vel + 0.5 * dt**2 * (model + k.dist)
    k.innovation += share(dt, has.adaptive.lag_s) * (pos - ahead - k.innovation)
    square = float(np.sum(k.innovation**2))
    expected = has.adaptive.threshold**2 * k.noise_m2 * dt / (2.0 * has.adaptive.lag_s + dt)
    k.mu = min(np.sqrt(1.0 + square / expected), has.adaptive.most)


def _heading(k: Estimate, has: Traits, seen: bool, dt: float, turn: float) -> None:
    """An FTESO on the unwrapped angle, fed the angular acceleration that was asked for; of one only observed, two."""
    psi, rate, more = k.heading
    if not seen:
        k.fast_heading[2] = 0.0
        k.heading = np.array([psi + dt * rate + 0.5 * dt**2 * (turn + more), rate + dt * turn, 0.0])
        return
    ahead = psi + dt * rate + 0.5 * dt**2 * (turn + more)
    miss = float(np.angle(np.exp(1j * (heading_of(k.r) - ahead))))
    y, gains, second = ahead + miss, has.heading, has.second_heading
    fast_weight = k.turn_ratio**4 / (1.0 + k.turn_ratio**4)
    slow = k.heading - fast_weight * k.fast_heading
    stepped = fteso_backward(slow, y, turn, dt, gains.w, gains.a, gains.e0, gains.smooth)
    if second.w > 0.0:
        fast = fteso_backward(slow + k.fast_heading, y, turn, dt, second.w, gains.a, gains.e0, gains.smooth)
        k.fast_heading = fast - stepped
        noise = max(has.quiet_rad, np.sqrt(k.noise_rad2))
        passed = noise * np.sqrt(min(second.w * dt, 1.0)) * second.w ** np.arange(3)
        beyond = np.max(np.abs(k.fast_heading) / (np.array(second.sigmas) * passed))
        k.turn_ratio = max(beyond, k.turn_ratio * np.exp(-dt / second.hold_s))
        fast_weight = k.turn_ratio**4 / (1.0 + k.turn_ratio**4)
    k.heading = stepped + fast_weight * k.fast_heading


def dist_rate(k: Estimate, has: Traits) -> np.ndarray:
    """Of a push that the fast observer sees, along x and y, and that has not changed sides of late."""
    weight = k.fast_weight / (1.0 + (k.turns / 0.5) ** 8)
    return np.append(weight * has.second.w / 5.0 * (k.dist[:2] - k.dist_late), 0.0)


def dist_after(k: Estimate, has: Traits, h: float) -> np.ndarray:
    """Z3 in h: it goes on at its rate, which decays in 0.1 s."""
    return k.dist + dist_rate(k, has) * 0.1 * (1.0 - np.exp(-h / 0.1))


def age_s(k: Estimate) -> float:
    """Since it was last seen; for ever, if never."""
    return np.inf if k.seen_ns is None else (k.t_ns - k.seen_ns) * SECONDS


def acceleration(k: Estimate, has: Traits) -> np.ndarray:
    """Modelled acceleration plus Z3."""
    return k.strength * k.force - has.drag * k.vel + k.dist - (np.array([0.0, 0.0, G]) if has.commanded else 0.0)


def turning(k: Estimate, turn: float) -> float:
    """Angular acceleration of the heading."""
    return turn + k.heading[2]
