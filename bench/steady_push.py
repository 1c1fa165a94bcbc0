"""`python -m bench.steady_push`: does a hovering drone come to rest in a push that begins at once and stays?

The push is a share of what the tilt limit can hold against, over slower motors than the controller believes: the
operating range in which the loop must have one rest and no limit cycle.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import typer
from rich.console import Console

from bench.command import FAILED, Only, Seeds, Vehicle, without_nan
from formation.vehicle.profile import PAPER_40G, VehicleProfile
from sim.cli.studies import vehicle_profile
from sim.research import experiments, host
from sim.research.experiments import Experiment, Job
from sim.research.host import Host
from sim.research.push import Settling, settling
from sim.runner import Runner
from sim.scenario import Scenario, TrueVehicle

SHARES = (0.3, 0.6, 0.9)
"""Of the push that the tilt limit holds against."""
MOTOR_LAGS = (1.0, 1.3, 1.6)
"""True motor lag over the profile's."""


@dataclass(frozen=True, slots=True)
class Push:
    """One flight: which controller and vehicle, in a push of that share, with motors so much slower, by which seed and
    host."""

    share: float
    motor_lag: float = 1.0
    controller: str = "cfc"
    vehicle: VehicleProfile = PAPER_40G
    seed: int = 1
    host: Host = Host.STUDY


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
    result, flight = host.fly(scenario_of(job), job.seed, host=job.host)
    return settling(flight, result)


def main(seeds: Seeds = 1, vehicle: Vehicle = "paper_40g", only: Only = None) -> None:
    """Hover in a push that begins at once and stays, with slower motors than believed; exit code 1 if any swings on."""
    try:
        pushes = jobs(only or ["cfc"], vehicle_profile(vehicle), range(1, seeds + 1))
    except ValueError as error:
        raise typer.BadParameter(str(error)) from error
    flown = Runner(Console(stderr=True, markup=False)).run("flights", fly, pushes)
    rows = [
        {"controller": j.controller, "share": j.share, "motor_lag": j.motor_lag, "seed": j.seed} | asdict(f)
        for j, f in zip(pushes, flown, strict=True)
    ]
    print(json.dumps(without_nan(rows), indent=2))
    if not all(met.at_rest for met in flown):
        raise typer.Exit(FAILED)


if __name__ == "__main__":
    typer.run(main)
