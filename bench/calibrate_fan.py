"""`python -m bench.calibrate_fan`: the fan of the gust experiment, by the paper's own figure of its ISTSMC."""

import json

import numpy as np
import typer
from rich.console import Console

from bench.command import FAILED, Json, Vehicle
from formation.vehicle.profile import VehicleProfile
from sim.cli.studies import vehicle_profile
from sim.research.experiments import Experiment, Job, fly
from sim.runner import Runner

TARGET_M, TOLERANCE_M = 0.30, 0.005
SEEDS = tuple(range(101, 107))
"""None of those that `gcs-sim paper` shows."""
PEAK_M_S2, PEAK_STEPS = 7.0, 6


def calibrate(vehicle: VehicleProfile, console: Console) -> float:
    """The fan's peak push (m/s^2) in which the printed ISTSMC alone deviates by 0.30 m in the mean over the passes.

    By the secant of the medians over the seeds. Shows each peak flown and the deviation in it. ValueError where no
    peak gives it.
    """
    peak, slope = PEAK_M_S2, TARGET_M / PEAK_M_S2
    before: tuple[float, float] | None = None
    for _ in range(PEAK_STEPS):
        flights = [Job("istsmc", Experiment.GUST, s, vehicle=vehicle, gust_peak_m_s2=peak) for s in SEEDS]
        scores = Runner(console).run(f"{peak:.2f} m/s²", fly, flights)
        known_m = [score.gust.mean_dev_m for score in scores if np.isfinite(score.gust.mean_dev_m)]
        if not known_m:
            break
        deviation_m = float(np.median(known_m))
        console.print(f"peak {peak:.3f} m/s²: {1e3 * deviation_m:.1f} mm", highlight=False)
        if abs(deviation_m - TARGET_M) < TOLERANCE_M:
            return peak
        if before is not None:
            slope = (deviation_m - before[1]) / (peak - before[0])
        before = peak, deviation_m
        if slope <= 0.0:
            break
        peak = min(max(peak + (TARGET_M - deviation_m) / slope, 0.5 * peak), 2.0 * peak)
    raise ValueError(f"no fan was found that moves {vehicle.name} by {TARGET_M:g} m under the printed ISTSMC")


def main(vehicle: Vehicle = "paper_40g", as_json: Json = False) -> None:
    """Find the fan that moves the printed ISTSMC by 0.30 m; exit code 1 where there is none."""
    console = Console(stderr=as_json, markup=False)
    try:
        peak = calibrate(vehicle_profile(vehicle), console)
    except ValueError as error:
        console.print(str(error), style="red", highlight=False)
        raise typer.Exit(FAILED) from error
    console.print(f"peak_m_s2 = {peak:.2f}", highlight=False)
    if as_json:
        print(json.dumps({"peak_m_s2": peak}))


if __name__ == "__main__":
    typer.run(main)
