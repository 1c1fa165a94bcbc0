"""Compiles everything the control runs, before any motor turns: nothing compiles in flight."""

import numpy as np

from formation import frames
from formation.config import LabConfig
from formation.messages import MocapFrame
from formation.reference import HERE, IDLE, Leg, Mode, Plan
from formation.shape import Shape, configured
from formation.transition import Space, transition
from gcs.core import GcsCore
from gcs.pipeline import Pipeline

FRAME_NS = 10_000_000
FRAMES_EACH = 5


def warm_up(config: LabConfig) -> None:
    """Fly a throwaway pipeline and core of this lab through every mode, on frames of bodies that stand still."""
    pipeline = Pipeline(config)
    shape = configured(config)
    hover = np.array([config.profile_of(config.vehicles[i]).hover_thrust_norm for i in config.commanded])
    now_ns, seq = FRAME_NS, 0
    for leg in (IDLE, Leg(Mode.LAB, (None, None, 0.3)), Leg(Mode.FORMATION), Leg(Mode.LAB, HERE), IDLE):
        plan = Plan(tuple(leg for _ in config.commanded), shape, now_ns)
        for _ in range(FRAMES_EACH):
            now_ns, seq = now_ns + FRAME_NS, seq + 1
            pipeline.step(now_ns, pipeline.align(_frame(config, seq, now_ns)), plan, hover)
    _change_shape()
    _watch_over(config)


def _watch_over(config: LabConfig) -> None:
    """Safety's kernels, by way of a core that is asked for its state and refuses to arm."""
    core = GcsCore(config, 0)
    core.receive(_frame(config, 0, FRAME_NS), FRAME_NS)
    core.tick(FRAME_NS)
    core.status(FRAME_NS)


def _change_shape() -> None:
    """A single follower changes sides, over its leader."""
    motion = np.zeros((1, 3, 4))
    motion[0, 0, 0] = 2.0
    beyond = Shape("beyond", ((-2.0, 0.0, 0.0),), (0.0,))
    transition(beyond, motion, Space(0.1, 0.2, 0.0, 1.0, 1.0), ("leader", "follower"))


def _frame(config: LabConfig, seq: int, now_ns: int) -> MocapFrame:
    """Bodies in a row, a metre apart, with a body unseen now and then."""
    n = len(config.vehicles)
    pos = np.zeros((n, 3))
    pos[:, 0], pos[:, 2] = np.arange(n), 0.3 + 1e-4 * (seq % 3)
    seen = np.full(n, seq % 4 != 3)
    bodies = tuple(v.body for v in config.vehicles)
    return MocapFrame(seq, now_ns, bodies, pos, np.tile(frames.IDENTITY, (n, 1)), seen)
