"""What an autopilot has of its vehicle, simulated or a Crazyflie: samples and an estimate come in, orders go out."""

from dataclasses import dataclass
from typing import NamedTuple, Protocol

from drone_agent.autopilots.model import Fusion
from drone_agent.guard.position import Belief, LoopSetpoint
from formation.maths.arrays import Float, Quat, Vec3


@dataclass(frozen=True, slots=True)
class ImuSample:
    """Means over the time until `t_ns`; values (6): specific force, m/s^2 (+g along up at rest), and rate, rad/s."""

    t_ns: int
    values: Float

    @property
    def specific_force_flu_m_s2(self) -> Vec3:
        """In `flu`."""
        return self.values[0:3]

    @property
    def rate_flu_rad_s(self) -> Vec3:
        """In `flu`."""
        return self.values[3:6]


class ExternalPose(NamedTuple):
    """A pose from outside, its capture on this agent's own clock."""

    t_capture_ns: int
    pos_lab_m: Vec3
    q_lab_from_flu: Quat


class Pack(Protocol):
    """A battery as its power module measures it; NaN where it does not."""

    @property
    def cells(self) -> int:
        """In series."""
        ...

    @property
    def remaining(self) -> float:
        """Charge left, 0..1."""
        ...

    @property
    def voltage_v(self) -> float:
        """Of the pack."""
        ...

    @property
    def cell_v(self) -> float:
        """Of each cell."""
        ...

    @property
    def current_a(self) -> float:
        """Now."""
        ...

    @property
    def used_mah(self) -> float:
        """Since it was full."""
        ...


class Estimate(Protocol):
    """Where the vehicle believes it is; the views are of the newest sample."""

    @property
    def t_ns(self) -> int:
        """When that sample was taken."""
        ...

    @property
    def q_lab_from_flu(self) -> Quat:
        """Attitude."""
        ...

    @property
    def pos_lab_m(self) -> Vec3:
        """Position."""
        ...

    @property
    def vel_lab_m_s(self) -> Vec3:
        """Velocity."""
        ...

    @property
    def rate_flu_rad_s(self) -> Vec3:
        """Body rate."""
        ...

    @property
    def climbed_m_s(self) -> float:
        """The climb since boot by the inertial samples alone: its differences are what no pose can feign."""
        ...

    def belief(self) -> Belief:
        """Position, velocity and heading."""
        ...

    def rest(self) -> None:
        """It is disarmed on the floor: it stands still."""
        ...

    def valid(self, now_ns: int) -> bool:
        """Whether a flight may go on with the position."""
        ...

    def fault(self, now_ns: int) -> str | None:
        """Why one must not arm on it, or None."""
        ...

    def receive_pose(self, pose: ExternalPose, now_ns: int, fusion: Fusion) -> None:
        """Fuse a pose from outside."""
        ...


class Vehicle(Protocol):
    """One vehicle."""

    armed: bool
    setpoint: LoopSetpoint
    """What its attitude loop tracks, in the axes of the autopilot's estimate."""

    @property
    def link_loss(self) -> float:
        """Share of the packets between it and this process that are lost, 0..1."""
        ...

    @property
    def pack(self) -> Pack:
        """What its power module measures."""
        ...

    @property
    def newest_sample(self) -> ImuSample | None:
        """Of its inertial sensors."""
        ...

    def order(self, now_ns: int, setpoint: LoopSetpoint) -> None:
        """Let `setpoint` reach the attitude loop, after the delay of its own and after those ordered before it."""
        ...

    def order_now(self, setpoint: LoopSetpoint) -> None:
        """Let `setpoint` rule at once; what was on its way is forgotten."""
        ...

    def stop(self) -> None:
        """Motors off in flight, for good where the vehicle can latch it; it is disarmed next."""
        ...

    def advance_to(self, now_ns: int) -> None:
        """Let what a simulated one does happen up to `now_ns`."""
        ...

    def drain(self, dt_s: float) -> None:
        """Take `dt_s` at the present thrust out of a simulated pack."""
        ...
