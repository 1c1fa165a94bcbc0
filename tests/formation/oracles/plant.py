"""A point mass in air that answers attitude targets by dead time and first-order lag; takes a profile for its numbers.

Imports nothing of the product.
"""

from typing import Any

import numpy as np

from tests.formation.oracles.frames import G, attitude_matrix, axis_angle, rotation_matrix
from tests.formation.oracles.response import answered


class Plant:
    """A point mass that feels what it is sent after a dead time and a lag; its yaw rate follows the one asked for."""

    def __init__(self, body: Any, t_ns: int, pos: np.ndarray) -> None:
        self.body, self.pos, self.vel, self.force, self.yaw = (
            body,
            pos.copy(),
            np.zeros(3),
            np.array([0.0, 0.0, G]),
            0.0,
        )
        self.turn = 0.0
        self.sent_ns, self.sent = [t_ns - 10**9], [np.array([0.0, 0.0, G, 0.0, 0.0])]

    @property
    def q(self) -> np.ndarray:
        r = attitude_matrix(self.force, self.yaw)
        w = 0.5 * np.sqrt(1.0 + np.trace(r))
        return np.array([w, *(np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]) / (4.0 * w))])

    def send(self, now_ns: int, q: np.ndarray, rate: np.ndarray, thrust: float) -> None:
        r = rotation_matrix(q)
        along, lead = r[:, 2], np.array([rate[0], rate[1], 0.0]) / self.body.attitude_p_1_s
        angle = np.linalg.norm(lead)
        if self.body.rate_feed_forward and angle > 0.0:  # body rates over the attitude's gain are an attitude ahead
            along = r @ axis_angle(lead / angle, angle)[:, 2]
        size = self.body.thrust_n_of(thrust) / self.body.mass_kg
        self.sent_ns.append(now_ns)
        self.sent.append(np.array([*(size * along), np.arctan2(r[1, 0], r[0, 0]), rate[2]]))

    def advance(self, from_ns: int, to_ns: int) -> None:
        times, sent, body, h = np.array(self.sent_ns), np.array(self.sent), self.body, (to_ns - from_ns) * 1e-9
        sideways = (body.response_dead_time_s, body.response_lag_s)
        flat = answered(times, sent[:, :2], from_ns, to_ns, *sideways, self.force[:2])
        up = answered(times, sent[:, 2:3], from_ns, to_ns, body.thrust_dead_time_s, body.thrust_lag_s, self.force[2:])
        self.force, speed, travel = (np.concatenate(pair) for pair in zip(flat, up, strict=True))
        x, y, z = body.drag_n_s_m
        drag = np.array([(x + y) / 2.0, (x + y) / 2.0, z]) / body.mass_kg
        moved = (h * self.vel + travel - [0.0, 0.0, 0.5 * h**2 * G]) / (1.0 + 0.5 * h * drag)
        self.pos = self.pos + moved
        self.vel = self.vel + speed - [0.0, 0.0, h * G] - drag * moved
        asked = sent[-1, 4] + body.yaw_p_1_s * np.angle(np.exp(1j * (sent[-1, 3] - self.yaw)))
        self.turn += (1.0 - np.exp(-h / (1.0 / body.rate_yaw_p_1_s + body.motor_lag_s))) * (asked - self.turn)
        self.yaw += h * self.turn
