"""`gcs-sim steady-push`: does a hovering drone come to rest in a push that begins at once and stays?

The push is a share of what the tilt limit can hold against, over slower motors than the controller believes: the
operating range in which the loop must have one rest and no limit cycle.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from formation.vehicle.profile import PAPER_40G, VehicleProfile
from sim import lockstep
from sim.scenario import Scenario, TrueVehicle
from sim.studies import experiments
from sim.studies.experiments import Experiment, Job
from sim.studies.push import Settling, settling

SHARES = (0.3, 0.6, 0.9)
"""Of the push that the tilt limit holds against."""
MOTOR_LAGS = (1.0, 1.3, 1.6)
"""True motor lag over the profile's."""


@dataclass(frozen=True, slots=True)
class Push:
    """One flight: which controller and vehicle, in a push of that share, with motors so much slower, by which seed."""

    share: float
    motor_lag: float = 1.0
    controller: str = "cfc"
    vehicle: VehicleProfile = PAPER_40G
    seed: int = 1


def jobs(controllers: Sequence[str], vehicle: VehicleProfile, seeds: Sequence[int]) -> list[Push]:
    """Every flight of the sweep; ValueError names the known controllers."""
    if unknown := set(controllers) - set(experiments.CONTROLLERS):
        raise ValueError(f"unknown controller {min(unknown)!r}; known: {', '.join(experiments.CONTROLLERS)}")
    return [Push(s, lag, c, vehicle, n) for c in controllers for s in SHARES for lag in MOTOR_LAGS for n in seeds]


def scenario_of(job: Push) -> Scenario:
    """The hover in that push, of a vehicle with slower motors."""
    scenario = experiments.scenario_of(
        Job(job.controller, Experiment.PUSH, job.seed, vehicle=job.vehicle, push_share=job.share)
    )
    slower: dict[str, float | bool | tuple[float, float, float]] = {
        "motor_lag_s": job.motor_lag * job.vehicle.motor_lag_s
    }
    vehicles = tuple(
        TrueVehicle(sysid=v.sysid, start=scenario.true_vehicle(v.sysid).start, vehicle=slower)
        for v in scenario.lab.vehicles
        if v.sysid is not None
    )
    return scenario.model_copy(update={"vehicles": vehicles})


def fly(job: Push) -> Settling:
    """Fly the job and measure it."""
    flown, flight = lockstep.run_and_load(scenario_of(job), job.seed)
    return settling(flight, flown.outcome.result)
