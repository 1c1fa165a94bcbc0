"""An imaginary flight of a few ticks, so that nothing compiles once motors turn."""

import numpy as np

from formation.config import LabConfig
from formation.control.stack import ControlStack
from formation.guidance.plan import IDLE, Mode, Plan, Setpoint
from formation.guidance.shape import configured
from formation.maths import frames
from formation.messages import LabFrame
from formation.own_law.flight import OwnLaws
from formation.vehicle.profile import VehicleProfile

FRAME_NS = 10_000_000


def warm_up(config: LabConfig, profiles: tuple[VehicleProfile, ...], own: OwnLaws | None = None) -> None:
    """Takes off, joins the formation and lands in imagination: every kernel of the stack is loaded or compiled.

    own: the lab's own laws, made for this alone.
    """
    stack = ControlStack(config, profiles, own=own)
    n, m = len(config.vehicles), len(config.commanded)
    bodies = tuple(v.body for v in config.vehicles)
    hover = np.array([profiles[i].hover_thrust_norm for i in config.commanded])
    q, bias = np.tile(frames.IDENTITY, (n, 1)), np.full((m, 2), 0.01)
    shape = configured(config)
    setpoints = (
        IDLE,
        *(Setpoint(Mode.LAB, (None, None, 0.3)),) * 3,
        *(Setpoint(Mode.FORMATION),) * 3,
        Setpoint(Mode.LAB, (None, None, -0.3)),
    )
    heights_m = (0.0, 0.0, 0.1, 0.2, 0.3, 0.3, 0.3, 0.3)
    for k, (setpoint, height_m) in enumerate(zip(setpoints, heights_m, strict=True)):
        pos = np.column_stack([np.arange(n, dtype=np.float64), np.zeros(n), np.full(n, height_m)])
        frame = LabFrame(k, (k + 1) * FRAME_NS, bodies, pos, q, np.ones(n, dtype=np.bool_))
        stack.step((k + 1) * FRAME_NS + FRAME_NS // 2, frame, Plan((setpoint,) * m, shape, FRAME_NS), hover, None, bias)
