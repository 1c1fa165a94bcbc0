"""What an autopilot has of its vehicle: inertial samples come in, orders go out. Its true state is not there."""

from dataclasses import dataclass
from typing import Protocol

from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.battery import BatteryPack
from formation.maths.arrays import Float, Vec3


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


class Vehicle(Protocol):
    """One vehicle."""

    armed: bool
    setpoint: LoopSetpoint
    """What its attitude loop tracks, in the axes of the autopilot's estimate."""

    @property
    def pack(self) -> BatteryPack:
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
