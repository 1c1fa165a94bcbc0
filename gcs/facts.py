"""Gathers what safety decides on, from the newest estimate and the links."""

import numpy as np
from numpy.typing import ArrayLike

from formation.arrays import Bool, Float
from formation.config import LabConfig
from formation.control.stack import Stages
from formation.safety import Facts
from gcs.checks import objections
from gcs.drone import Drone


class FactGatherer:
    """The facts of one lab; what a body has no link for reads as healthy."""

    def __init__(self, config: LabConfig, drones: tuple[Drone, ...]) -> None:
        self._names = tuple(v.body for v in config.vehicles)
        self._drones = drones
        self._own = np.array([drone.index for drone in drones])
        self._commanded = np.isin(np.arange(len(self._names)), self._own)

    def gather(self, stages: Stages | None, late_share: float, now_ns: int, asked_to_arm: bool = False) -> Facts:
        """The facts now. Objections of the links are gathered only where arming is asked for."""
        links = [drone.link for drone in self._drones]
        heartbeat_age_s = [link.heartbeat_age_s(now_ns) for link in links]
        n = len(self._names)
        if stages is None:
            pos, speed, tilt = np.zeros((n, 3)), np.zeros(n), np.zeros(n)
            age, error = np.full(n, np.inf), np.zeros(n)
        else:
            state = stages.state
            pos, age = state.pos_lab_m, state.age_s + (now_ns - state.t_ns) * 1e-9
            speed = np.sqrt(np.einsum("ij,ij->i", state.vel_lab_m_s, state.vel_lab_m_s))
            x, y = state.q_lab_from_flu[:, 1], state.q_lab_from_flu[:, 2]
            tilt = np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0))
            e = stages.command.e_lead_m
            error = self._numbers(np.sqrt(np.einsum("ij,ij->i", e, e)), 0.0)
        return Facts(
            names=self._names,
            commanded=self._commanded,
            pos_lab_m=pos,
            speed_m_s=speed,
            tilt_rad=tilt,
            age_s=age,
            error_m=error,
            heartbeat_age_s=self._numbers(heartbeat_age_s, 0.0),
            armed=self._flags([link.armed for link in links], True),
            offboard=self._flags([link.offboard for link in links], True),
            battery=self._numbers([link.told.battery for link in links], np.nan),
            duplicate=self._flags([link.sequence.duplicate(now_ns) for link in links], False),
            late_share=late_share,
            objections=tuple(text for link in links for text in objections(link)) if asked_to_arm else (),
        )

    def _numbers(self, values: ArrayLike, otherwise: float) -> Float:
        """Values of the m commanded vehicles among all n."""
        spread = np.full(len(self._names), otherwise)
        spread[self._own] = values
        return spread

    def _flags(self, values: ArrayLike, otherwise: bool) -> Bool:
        spread = np.full(len(self._names), otherwise)
        spread[self._own] = values
        return spread
