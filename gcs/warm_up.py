"""Compiles everything the ground runs, before any motor turns: nothing compiles in flight."""

import numpy as np

from formation import warm_up as control
from formation.config import LabConfig
from formation.control.margin import kicked_hover
from formation.control.presets import preset_for
from formation.guidance.shape import Shape
from formation.guidance.transition import Space, assigned, transition
from formation.maths import frames
from formation.messages import AttitudeTarget, LabFrame
from formation.paper.eq2_relative_frame import lead_from_lab
from formation.safety.attitude_innovation import AttitudeMonitor
from formation.warm_up import FRAME_NS
from gcs.core import GcsCore, own_laws
from wire.link_messages import DRONE_COMPONENT, GROUND, Address
from wire.mavlink.batches import PoseBatch, SetpointBatch
from wire.process.deadline import Deadline

LAW_S = 5.0
"""For the lab's own laws in one imagined tick, in which they may compile, too."""


def warm_up(config: LabConfig) -> None:
    """Fly the control of this lab in imagination, change a shape, and let safety judge bodies that stand in a row."""
    control.warm_up(
        config,
        tuple(config.profile_of(vehicle) for vehicle in config.vehicles),
        own_laws(config, Deadline(LAW_S, LAW_S)),
    )
    _change_shape()
    _watch_over(config)
    _encode()
    _judge(config)


def _judge(config: LabConfig) -> None:
    """Two frames of the hover by which a vehicle's delay margin is found."""
    profile, mocap = config.profile_of(config.leader), config.mocap
    kicked_hover(profile, preset_for(config.control_preset, profile, mocap), mocap, 0.0, 2.0 / mocap.rate_hz)


def _change_shape() -> None:
    """A single follower changes sides, over its leader."""
    motion = np.zeros((1, 3, 4))
    motion[0, 0, 0] = 2.0
    beyond = Shape("beyond", ((-2.0, 0.0, 0.0),), (0.0,))
    dealt = assigned(beyond, motion[:, 0, :3])
    transition(dealt, motion, Space(0.1, 0.2, 0.0, 1.0, 1.0), ("leader", "follower"))
    lead_from_lab(motion[0], np.zeros((3, 4)), np.zeros((3, 4)))


def _encode() -> None:
    """A setpoint of one drone, and a pose."""
    target = AttitudeTarget(0, np.ones((1, 4)), np.zeros((1, 3)), np.zeros(1), np.zeros(1), np.zeros(1, np.bool_))
    SetpointBatch(GROUND, (Address(1, DRONE_COMPONENT),)).encode(target, 0, (0,), (0,))
    PoseBatch(GROUND, 1).encode(0, np.zeros((1, 3)), target.q_lab_from_flu, (0,))


def _watch_over(config: LabConfig) -> None:
    """The mocap's alignment and safety's kernels, by way of a core that is asked for its state and refuses to arm."""
    n = len(config.vehicles)
    pos = np.zeros((n, 3))
    pos[:, 0] = np.arange(n)
    bodies = tuple(v.body for v in config.vehicles)
    core, monitor = GcsCore(config, 0), AttitudeMonitor(n)
    frame = LabFrame(0, FRAME_NS, bodies, pos, np.tile(frames.IDENTITY, (n, 1)), np.ones(n, np.bool_))
    core.receive(frame, FRAME_NS)
    core.tick(FRAME_NS)
    core.state(FRAME_NS)
    monitor.receive_frame(frame)
    monitor.receive_attitudes(np.arange(n), np.full(n, FRAME_NS), frame.q_lab_from_flu)
