"""Vehicles that are not what the controller believes, five of them, by name: bodies that could stand in the room.

Each is the believed vehicle times factors at the edge of what `bench.robustness` draws at random: 30 % of mass, with
the inertia that the same body made of heavier or lighter stuff has, half of the lags, twice the delays (of cameras,
links and vehicle). Weak motors are an empty battery (0.85) and old propellers.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from sim.scenario import Scenario, TrueVehicle


@dataclass(frozen=True, slots=True)
class Mismatch:
    """What is truly there, over what is believed; lag: of motors and attitude loop; mass: inertia with it."""

    mass: float = 1.0
    lag: float = 1.0
    delay: float = 1.0
    thrust: float = 1.0


MISMATCHES: Mapping[str, Mismatch] = MappingProxyType(
    {
        "heavy and slow": Mismatch(mass=1.3, lag=1.5),
        "light and fast": Mismatch(mass=0.7, lag=0.5),
        "half delay": Mismatch(delay=0.5),
        "double delay": Mismatch(delay=2.0),
        "weak motors": Mismatch(thrust=0.75),
    }
)


def off_by(scenario: Scenario, off: Mismatch) -> Scenario:
    """The scenario with every drone, the cameras' delay and the links off by so much; the lab believes as before."""
    lab = scenario.lab
    vehicles = []
    for config in lab.vehicles:
        if config.sysid is None:
            continue
        believed = lab.profile_of(config)
        jx, jy, jz = believed.inertia_kg_m2
        true: dict[str, float | bool | tuple[float, float, float]] = {
            "mass_kg": off.mass * believed.mass_kg,
            "inertia_kg_m2": (off.mass * jx, off.mass * jy, off.mass * jz),
            "thrust_max_n": off.thrust * believed.thrust_max_n,
            "motor_lag_s": off.lag * believed.motor_lag_s,
            "attitude_p_1_s": believed.attitude_p_1_s / off.lag,
            "rate_p_1_s": believed.rate_p_1_s / off.lag,
            "command_delay_s": off.delay * believed.command_delay_s,
        }
        start = scenario.true_vehicle(config.sysid).start
        vehicles.append(TrueVehicle(sysid=config.sysid, start=start, vehicle=true))
    link = scenario.link
    update: dict[str, object] = {
        "vehicles": tuple(vehicles),
        "mocap": scenario.mocap.model_copy(update={"delay_s": off.delay * scenario.mocap.delay_s}),
        "link": link.model_copy(update={"down_s": off.delay * link.down_s, "up_s": off.delay * link.up_s}),
    }
    return scenario.model_copy(update=update)
