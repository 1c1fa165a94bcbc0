"""`python -m bench.performance_bound --vehicle px4_quad`: formation.vehicle.bound, by a controller's reaction time."""

import json
from dataclasses import replace

import typer

from bench.command import Json, Vehicle
from formation.vehicle.bound import least_deviation_by_attitude_m, least_deviation_m, turning
from sim.cli.studies import vehicle_profile
from sim.studies.bound import attitude_loop, gust_push, reaction_s, seen_s
from sim.studies.experiments import Experiment, Job, scenario_of

REACTIONS_S = (0.01, 0.02, 0.03, 0.04, 0.05, 0.06)


def main(vehicle: Vehicle = "paper_40g", as_json: Json = False) -> None:
    """Print the least deviation in the gust that any controller could reach, by the time of its reaction."""
    scenario = scenario_of(Job("cfc", Experiment.GUST, seed=1, vehicle=vehicle_profile(vehicle)))
    push_m_s2, turns = gust_push(scenario), turning(vehicle_profile(vehicle))
    own_s = reaction_s(scenario)
    rows = [(seconds, "") for seconds in REACTIONS_S]
    rows += [
        (own_s, "  this loop: exposed at once, passed on, acted on"),
        (own_s + seen_s(scenario, push_m_s2), "  an estimate: not before the push shows in the mocap's noise"),
    ]
    bounds = []
    for seconds, whose in rows:
        least_m = least_deviation_m(push_m_s2, turns, seconds)
        bounds.append({"reaction_s": seconds, "least_deviation_m": least_m})
        typer.echo(f"acts after {1e3 * seconds:4.1f} ms: {1e3 * least_m:5.2f} mm at least{whose}", err=as_json)
    loop = attitude_loop(scenario)
    loops = {
        "by attitude commands": loop,
        "with an accelerometer": replace(loop, dead_s=loop.dead_s - scenario.mocap.delay_s),  # which no camera delays
    }
    for how, each in loops.items():
        least_m = least_deviation_by_attitude_m(push_m_s2, each)
        bounds.append({"reaction_s": each.dead_s, "lag_s": each.lag_s, "least_deviation_m": least_m})
        answer = f"dead for {1e3 * each.dead_s:.0f} ms, lag {1e3 * each.lag_s:.0f} ms"
        typer.echo(f"{how}: {1e3 * least_m:5.2f} mm at least, {answer}", err=as_json)
    if as_json:
        print(json.dumps(bounds))


if __name__ == "__main__":
    typer.run(main)
