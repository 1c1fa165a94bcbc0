"""Points that feel their commands after dead time and lag, under the whole stack: any number, some only observed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from formation.config import LabConfig
from formation.control.stack import ControlStack, Stages
from formation.estimation.response import answer, no_history, remember
from formation.guidance.plan import Plan
from formation.maths import frames
from formation.maths.arrays import Float
from formation.messages import LabFrame
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile, profile

START_NS = 10**12
PERIOD_NS, DELAY_NS = 10_000_000, 8_000_000
Seen = Callable[[float, Float, Float], tuple[Float, Float, Float]]
"""From time, true positions (n, 3) and attitudes (n, 4) to what cameras tell: positions, attitudes, seen (n)."""


def truly(t_s: float, pos: Float, q: Float) -> tuple[Float, Float, Float]:
    return pos, q, np.ones(len(pos), dtype=np.bool_)


@dataclass(frozen=True)
class Track:
    """True positions and velocities (T, n, 3), and what the stack said at each of the times t_s (T)."""

    t_s: Float
    pos: Float
    vel: Float
    stages: list[Stages]

    def apart(self) -> Float:
        """The least distance of any two at each time, (T,)."""
        gap = self.pos[:, :, None] - self.pos[:, None]
        distance = np.linalg.norm(gap, axis=-1) + np.where(np.eye(self.pos.shape[1]), np.inf, 0.0)
        return distance.min(axis=(1, 2))

    def speeds(self) -> Float:
        return np.linalg.norm(self.vel, axis=-1)


def fly_points(
    config: LabConfig, plan_at: Callable[[float], Plan], starts: Float, duration_s: float,
    carried: Callable[[float], Float] | None = None, seen: Seen = truly, without: frozenset[str] = frozenset(),
) -> Track:  # fmt: skip
    """From hovering at starts (n, 3). carried: where an observed leader is at a time (3)."""
    bodies = tuple(profile(v.profile) for v in config.vehicles)
    stack = ControlStack(config, bodies, without=without)
    own, names = list(config.commanded), tuple(v.body for v in config.vehicles)
    hover = np.array([bodies[i].hover_thrust_norm for i in own])
    weight = np.array([0.0, 0.0, GRAVITY_M_S2])
    pos, vel, force = starts.copy(), np.zeros_like(starts), np.tile(weight, (len(starts), 1))
    sent = remember(
        no_history(len(own)), START_NS - 10**9, np.tile([0.0, 0.0, GRAVITY_M_S2, GRAVITY_M_S2], (len(own), 1))
    )
    speed, travel, step_s = np.zeros(3), np.zeros(3), PERIOD_NS * 1e-9
    track, stages = [], []
    for k in range(round(duration_s / step_s)):
        t_s, t_ns = k * step_s, START_NS + k * PERIOD_NS
        if carried is not None:
            pos[0], vel[0] = carried(t_s), (carried(t_s + 1e-4) - carried(t_s - 1e-4)) / 2e-4
        track.append((t_s, pos.copy(), vel.copy()))
        told, q, flags = seen(t_s, pos.copy(), upright(force))
        frame = LabFrame(k, t_ns, names, told, q, flags)
        stages.append(stack.step(t_ns + DELAY_NS, frame, plan_at(t_s), hover))
        target = stages[-1].target
        felt_now = [felt(target.q_lab_from_flu[j], target.rate_flu_rad_s[j], target.thrust_norm[j], bodies[i])
                    for j, i in enumerate(own)]  # fmt: skip
        sent = remember(sent, t_ns + DELAY_NS, np.array(felt_now))
        for j, i in enumerate(own):
            b = bodies[i]
            for axes, dead_s, lag_s in ((slice(0, 2), b.response_dead_time_s, b.response_lag_s),
                                        (slice(2, 3), b.thrust_dead_time_s, b.thrust_lag_s)):  # fmt: skip
                answer(sent[j].t_ns, sent[j].force[:, axes], t_ns, t_ns + PERIOD_NS, dead_s, lag_s,
                       force[i, axes], speed[axes], travel[axes])  # fmt: skip
            pos[i] += step_s * vel[i] + travel - 0.5 * step_s * step_s * weight
            vel[i] += speed - step_s * weight
    t, p, v = (np.array(part) for part in zip(*track, strict=True))
    return Track(t, p, v, stages)


def upright(force: Float) -> Float:
    """Attitudes (n, 4) whose body z lie along the forces (n, 3)."""
    z = force / np.linalg.norm(force, axis=-1, keepdims=True)
    axis = np.column_stack([-z[:, 1], z[:, 0], np.zeros(len(z))])
    sine = np.linalg.norm(axis, axis=-1, keepdims=True)
    return frames.from_rotation_vector(axis / np.maximum(sine, 1e-12) * np.arctan2(sine, z[:, 2:]))


def felt(q: Float, rate: Float, thrust_norm: float, body: VehicleProfile) -> Float:
    """The specific force (4) that a target asks for, body rates counted as the attitude lead they are."""
    size = body.thrust_n_of(float(thrust_norm)) / body.mass_kg
    if body.rate_feed_forward:
        lead = rate * np.array([1.0, 1.0, 0.0]) / body.attitude_p_1_s
        q = frames.multiply(q, frames.from_rotation_vector(lead))
    z = frames.rotate(q, np.array([0.0, 0.0, 1.0]))
    return np.array([*(size * z), size])
