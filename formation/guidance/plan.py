"""What each commanded vehicle is asked to do: the plan, as the phase sets it."""

from dataclasses import dataclass
from enum import IntEnum

from formation.config import CONFIGURED
from formation.guidance.shape import Shape

Target = tuple[float | None, float | None, float | None]
HERE: Target = (None, None, None)
Velocity = tuple[float, float, float, float]
"""x, y, z in `lab`, m/s, and the turn about lab z, rad/s."""
STILL: Velocity = (0.0, 0.0, 0.0, 0.0)


class Mode(IntEnum):
    """In which frame a vehicle is led, if at all."""

    IDLE = 0
    """On the floor: zero thrust, observers at rest."""
    LAB = 1
    """To a point of the lab and stay there: take-off, hold, landing."""
    FORMATION = 2
    """A follower: its slot in the leader's frame. The leader itself: its trajectory."""


@dataclass(frozen=True, slots=True)
class Setpoint:
    """One vehicle's part of the plan. A change of it starts a smooth path from wherever the reference is.

    target_lab_m: for LAB; None in a coordinate keeps it, or brakes it gently to rest where it moves. So hold is
    HERE, take-off (None, None, altitude), landing (None, None, a depth under the floor) until the floor is met.
    yaw_rad: for LAB; None keeps the heading. speed_m_s bounds the path's speed while it closes the gap.
    vel_lab: for LAB with HERE; at this velocity it then goes on, until another setpoint comes.
    """

    mode: Mode
    target_lab_m: Target = HERE
    yaw_rad: float | None = None
    speed_m_s: float = 0.5
    vel_lab: Velocity = STILL


IDLE = Setpoint(Mode.IDLE)


@dataclass(frozen=True, slots=True)
class Plan:
    """The setpoints of the m commanded vehicles, the followers' shape, and when the leader's trajectory started.

    trajectory_start_ns: on the control clock; None: a leader in FORMATION waits where it is.
    A new `shape` starts a smooth, simultaneous change of all slots; rise_m: how far above (below, where negative) its
    straight way each follower passes half-way (formation.guidance.transition). Empty: all go straight.
    trajectory: the name of the leader's, looked at when it starts; resumes: it is the one of before, where that began.
    """

    setpoints: tuple[Setpoint, ...]
    shape: Shape
    trajectory_start_ns: int | None = None
    rise_m: tuple[float, ...] = ()
    trajectory: str = CONFIGURED
    resumes: bool = False
