"""The whole control stack on frames that are given to it one by one."""

from dataclasses import dataclass

import numpy as np

from formation.config import LabConfig
from formation.control.presets import Preset
from formation.control.stack import ControlStack, Stages
from formation.guidance.plan import Plan
from formation.messages import LabFrame
from formation.vehicle.profile import VehicleProfile


@dataclass(frozen=True)
class Look:
    """One frame and when the tick on it happens."""

    now_ns: int
    t_ns: int
    pos: np.ndarray
    q: np.ndarray
    seen: np.ndarray
    felt: np.ndarray | None = None


def flown(
    config: LabConfig,
    bodies: tuple[VehicleProfile, ...],
    gains: Preset,
    plan: Plan,
    looks: list[Look],
    hover: np.ndarray,
) -> list[Stages]:
    """The product on these frames."""
    stack, names = ControlStack(config, bodies, gains), tuple(v.body for v in config.vehicles)
    return [
        stack.step(k.now_ns, LabFrame(seq, k.t_ns, names, k.pos, k.q, k.seen), plan, hover, k.felt)
        for seq, k in enumerate(looks)
    ]
