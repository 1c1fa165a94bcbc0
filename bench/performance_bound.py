"""`python -m bench.performance_bound --vehicle px4_quad`: formation.vehicle.bound in the gust."""

import json
from dataclasses import replace

import typer

from bench.command import Json, Vehicle
from formation.vehicle.bound import least_deviation_by_attitude_m, least_deviation_m, turning
from sim.cli.studies import vehicle_profile
from sim.studies.bound import attitude_loop, gust_push, reaction_s
from sim.studies.experiments import Experiment, Job, scenario_of


def main(vehicle: Vehicle = "paper_40g", as_json: Json = False) -> None:
    """Print the least deviation in the gust that any controller could reach, by what it commands."""
    profile = vehicle_profile(vehicle)
    scenario = scenario_of(Job("cfc", Experiment.GUST, seed=1, vehicle=profile))
    push_m_s2, loop = gust_push(scenario), attitude_loop(scenario)
    sooner = replace(loop, dead_s=loop.dead_s - scenario.mocap.delay_s)  # no camera delays an accelerometer
    bounds_m = {
        "by motors": least_deviation_m(push_m_s2, turning(profile), reaction_s(scenario)),
        "by attitude commands": least_deviation_by_attitude_m(push_m_s2, loop),
        "with an accelerometer": least_deviation_by_attitude_m(push_m_s2, sooner),
    }
    for how, least_m in bounds_m.items():
        typer.echo(f"{how}: {1e3 * least_m:.2f} mm at least", err=as_json)
    if as_json:
        print(json.dumps(bounds_m))


if __name__ == "__main__":
    typer.run(main)
