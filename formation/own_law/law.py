"""What a lab's own control law is given, what it answers, and how long it may take.

Who runs the laws decides that: the host has a clock, the control has none.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

from numpy.typing import ArrayLike

from formation.maths.arrays import Vec3


@dataclass(frozen=True, slots=True, eq=False)
class PointMotion:
    """Position, velocity and acceleration of a point in `lab`, each (3)."""

    pos_lab_m: Vec3
    vel_lab_m_s: Vec3
    acc_lab_m_s2: Vec3


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """One follower when a command sent now takes hold: x and y after the attitude's dead time, z after the thrust's.

    body: its name; dt_s: since it was asked last, 0 at first; own: its motion as predicted, Z3 in its acceleration;
    slot: the motion that keeps it in its slot, the leader's turn in it; leader: the leader's own. heading_rad,
    heading_rate_rad_s: of the leader's frame, about lab z. error_lead_m, error_rate_lead_m_s (3): what it is off its
    slot and how that changes, in the leader's turning frame (Eq. 2). disturbance_lab_m_s2 (3): Z3, the acceleration
    that neither commands nor drag of the profile explain. lag_s: of the attitude behind its target, and of the thrust.
    saturated: the last target met a limit of tilt, so that an integral may not grow.
    """

    body: str
    dt_s: float
    own: PointMotion
    slot: PointMotion
    leader: PointMotion
    heading_rad: float
    heading_rate_rad_s: float
    error_lead_m: Vec3
    error_rate_lead_m_s: Vec3
    disturbance_lab_m_s2: Vec3
    lag_s: tuple[float, float]
    saturated: bool


class ControlLaw(Protocol):
    """Flies one follower from the moment when it is led into its slot until it is led elsewhere."""

    def __call__(self, at: Situation) -> ArrayLike:
        """The acceleration (3) demanded in `lab`, m/s^2, gravity and drag excluded: 0 stays as fast. Once a frame.

        Weight and the profile's drag are added to the force; Z3 is not: subtract it where it is to be compensated.
        It is bounded as any other demand is: by separation, speed and fence, tilt and thrust.
        """


class LawMaker(Protocol):
    """Makes a law, at rest; registered in the group `mavlink_formation.control_laws`."""

    def __call__(self, **options: Any) -> ControlLaw:
        """One follower's law, made anew each time it is led into a slot. options: the lab file's.

        ValueError says what is not right.
        """


Answer = TypeVar("Answer")


class LawOverrunError(BaseException):
    """The laws have not answered in time. No Exception, so that a law's own `except Exception` does not catch it."""


class LawGuard(Protocol):
    """Calls the laws of one tick."""

    def __call__(self, now_ns: int, call: Callable[[], Answer], /) -> Answer:
        """What `call` returns; whatever it raises, and LawOverrunError where it takes longer than it may.

        now_ns: the tick's time, by which a replay knows in which tick that was.
        """


def unlimited(_now_ns: int, call: Callable[[], Answer]) -> Answer:
    """As long as it takes."""
    return call()
