"""Flights drawn by a seed, in closed form: how n bodies move, and what their sensors and the mocap show."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drone_agent.guard.navigator import Fault, Navigator
from formation.maths.arrays import Float
from formation.maths.frames import from_rotation_vector, inverse, multiply, rotate
from formation.navigation.state import Airframe

MS, S = 1_000_000, 1_000_000_000
G = 9.8
WEIGHT = np.array([0.0, 0.0, G])
QUIET = (0.3, 0.3, 0.3)
SIH = (0.35, 1.2, 1.0)
"""PX4's SIH, armed: (0.5, 1.7, 1.4) m/s^2 in each sample at 400 Hz (sih.cpp), of which HIGHRES_IMU's 5 ms hold two."""


@dataclass(frozen=True)
class Flight:
    """How n bodies fly and what is wrong with their sensors, RMS or constant; drawn by `seed`.

    vel_m_s: RMS of the velocity along each axis, of four swings of any frequency in band_hz. gust_m_s2: RMS of a push
    that the rotors do not balance, correlated over a second. bias_m_s2, tilt_rad: of the accelerometer, and of the
    markers on the body. clock_s: poses are stamped by so much too late. imu_mean_s: of an inertial sample.
    """

    n: int = 10
    seed: int = 0
    vel_m_s: float = 0.4
    band_hz: tuple[float, float] = (0.1, 0.6)
    gust_m_s2: float = 0.0
    imu_m_s2: tuple[float, float, float] = QUIET
    gyro_rad_s: float = 0.01
    bias_m_s2: float = 0.1
    tilt_rad: float = 0.01
    clock_s: float = 0.0
    pose_m: float = 0.0003
    pose_rad: float = 0.001
    level_rad: float = 0.009
    yaw_rate_rad_s: float = 0.3
    imu_hz: int = 100
    pose_hz: int = 100
    imu_mean_s: float = 0.005


class Motion:
    """The true motion of a flight's bodies at any time; all arrays (..., n, 3) or (..., n, 4)."""

    def __init__(self, flight: Flight) -> None:
        self.flight = flight
        self.rng = np.random.default_rng(flight.seed)
        n, rng = flight.n, self.rng
        self.w = 2.0 * np.pi * rng.uniform(*flight.band_hz, (4, n, 3))
        self.phase = rng.uniform(0.0, 2.0 * np.pi, (4, n, 3))
        self.yaw = rng.uniform(0.0, 2.0 * np.pi, n)
        self.gust = np.array([0.6, 2.1, 5.2])[:, None, None] * np.ones((3, n, 3)) * rng.uniform(0.8, 1.25, (3, n, 3))
        self.gust_phase = rng.uniform(0.0, 2.0 * np.pi, (3, n, 3))
        self.bias = flight.bias_m_s2 * rng.standard_normal((n, 3))
        self.tilt = flight.tilt_rad * rng.standard_normal((n, 3))

    def vel_scale(self) -> Float:
        return self.flight.vel_m_s * np.sqrt(0.5) * np.array([1.0, 1.0, 0.5])

    def pos(self, t: Float) -> Float:
        a = self.w * np.asarray(t)[..., None, None, None] + self.phase
        return self.vel_scale() * (np.sin(a) / self.w).sum(axis=-3)

    def vel(self, t: Float) -> Float:
        a = self.w * np.asarray(t)[..., None, None, None] + self.phase
        return self.vel_scale() * np.cos(a).sum(axis=-3)

    def _acc(self, t: Float) -> Float:
        a = self.w * np.asarray(t)[..., None, None, None] + self.phase
        return -self.vel_scale() * (self.w * np.sin(a)).sum(axis=-3)

    def _push(self, t: Float) -> Float:
        a = self.gust * np.asarray(t)[..., None, None, None] + self.gust_phase
        push: Float = self.flight.gust_m_s2 * np.sqrt(2.0 / 3.0) * np.sin(a).sum(axis=-3)
        return push

    def q(self, t: Float) -> Float:
        """Rotors pull along body z against all but the gust."""
        pull = self._acc(t) + WEIGHT - self._push(t)
        z = pull / np.linalg.norm(pull, axis=-1, keepdims=True)
        up = np.concatenate([1.0 + z[..., 2:], -z[..., 1:2], z[..., 0:1], 0.0 * z[..., 0:1]], axis=-1)
        up /= np.linalg.norm(up, axis=-1, keepdims=True)
        half = 0.5 * (self.yaw + self.flight.yaw_rate_rad_s * np.asarray(t)[..., None])
        return multiply(up, np.stack([np.cos(half), 0.0 * half, 0.0 * half, np.sin(half)], axis=-1))

    def force(self, t: Float) -> Float:
        """Specific force in the body's axes."""
        return rotate(inverse(self.q(t)), self._acc(t) + WEIGHT)

    def rate(self, t: Float, dt: float = 0.002) -> Float:
        d = multiply(inverse(self.q(t - dt)), self.q(t + dt))
        return np.where(d[..., :1] < 0.0, -1.0, 1.0) * d[..., 1:] / dt


@dataclass
class Streams:
    """What arrives, by time: steps of imu and of poses."""

    imu_ns: np.ndarray
    force: Float
    rate: Float
    pose_ns: np.ndarray
    pos: Float
    q: Float
    attitude: Float


def sensed(motion: Motion, seconds: float, start_s: float = 0.0) -> Streams:
    """HIGHRES_IMU, means until their stamp; ATTITUDE_QUATERNION; poses a third of a period later."""
    f, rng, n = motion.flight, motion.rng, motion.flight.n
    imu_t = start_s + np.arange(1, round(seconds * f.imu_hz) + 1) / f.imu_hz
    pose_t = start_s + (np.arange(1, round(seconds * f.pose_hz)) + 0.37) / f.pose_hz
    noise = np.array(f.imu_m_s2) * rng.standard_normal((len(imu_t), n, 3))
    tilt = from_rotation_vector(motion.tilt)
    force = rotate(inverse(tilt), motion.force(imu_t - 0.5 * f.imu_mean_s)) + motion.bias + noise
    rate = rotate(inverse(tilt), motion.rate(imu_t - 0.5 * f.imu_mean_s)) + f.gyro_rad_s * rng.standard_normal(
        (len(imu_t), n, 3)
    )
    lean = np.zeros((len(imu_t), n, 3))
    kept = np.exp(-1.0 / f.imu_hz / 2.5)
    kicks = f.level_rad * np.sqrt(1.0 - kept * kept) * rng.standard_normal((len(imu_t), n, 3))
    lean[0] = f.level_rad * rng.standard_normal((n, 3))
    for k in range(1, len(imu_t)):
        lean[k] = kept * lean[k - 1] + kicks[k]
    attitude = multiply(from_rotation_vector(lean), multiply(motion.q(imu_t), tilt))
    turn = from_rotation_vector(f.pose_rad * rng.standard_normal((len(pose_t), n, 3)))
    shown_t = pose_t - f.clock_s
    pos = motion.pos(shown_t) + f.pose_m * rng.standard_normal((len(pose_t), n, 3))
    q = multiply(turn, motion.q(shown_t))
    return Streams(_ns(imu_t), force, rate, _ns(pose_t), pos, q, attitude)


def _ns(t: Float) -> np.ndarray:
    return np.round(t * 1e9).astype(np.int64)


def navigator(flight: Flight, airframe: Airframe | None = None) -> Navigator:
    return Navigator(flight.n, airframe, pose_rate_hz=flight.pose_hz)


def fly(
    nav: Navigator,
    streams: Streams,
    at_pose: Callable[[int], None] = lambda _: None,
    *,
    imu: bool = True,
    attitude: bool = True,
    attitude_first: bool = False,
) -> list[Fault]:
    """Feeds a navigator in order of time, every second attitude (50 Hz, as PX4); all faults it found.

    attitude_first: before the inertial sample of its time.
    """
    which, found = np.arange(streams.force.shape[1]), []
    k = 0
    for j, t_ns in enumerate(streams.pose_ns):
        while k < len(streams.imu_ns) and streams.imu_ns[k] <= t_ns + 10 * MS:
            times = np.full(len(which), streams.imu_ns[k])
            tells = attitude and k % 2 == 0
            if tells and attitude_first:
                nav.receive_attitude(which, times, streams.attitude[k], streams.rate[k])
            if imu:
                nav.receive_imu(which, times, streams.force[k], streams.rate[k])
            if tells and not attitude_first:
                nav.receive_attitude(which, times, streams.attitude[k], streams.rate[k])
            k += 1
        nav.receive_pose(which, np.full(len(which), t_ns), streams.pos[j], streams.q[j])
        found += nav.new_faults()
        at_pose(j)
    return found
