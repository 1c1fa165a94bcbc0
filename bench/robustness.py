"""`python -m bench.robustness`: flights of vehicles that differ from what the controller believes, drawn by seed.

A seed decides everything: the experiment, every drone's true vehicle and whether its autopilot sends HIGHRES_IMU, the
mocap, the links, the moment of a dropout.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from analysis.console import print_summary
from analysis.load import Flight
from analysis.metrics import Summary, summarise
from bench.command import FAILED, Json, without_nan
from formation.codes import GOOD_RESULTS
from formation.config import Fence
from formation.maths.arrays import Bool
from formation.messages import Phase
from formation.vehicle.profile import VehicleProfile, profile
from sim import lockstep
from sim.cameras.emulator import EmulatorConfig, Gap
from sim.cli.conclude import conclude
from sim.cli.studies import Full, host_of
from sim.faults.poses import NOISE_RAD_PER_M
from sim.research import host, push
from sim.research.experiments import FORMATION_S, SCENARIOS, Experiment
from sim.research.host import Host
from sim.runner import Runner
from sim.scenario import LinkModel, Scenario, TrueVehicle, flown_by, load
from wire.files import new_folder

MASS = INERTIA = 0.3
CURVE = 0.1
LAG = 0.5
DELAY_MAX = 2.0
NOISE_M = (0.0001, 0.001)
RATES_HZ = (50.0, 100.0, 240.0)
DROPOUT_S = 0.05
WITHOUT_ACCELEROMETER = 0.2
"""The share of drones whose autopilot sends no HIGHRES_IMU."""
SWING_DEG = 5.0
"""So much at the end of a steady push is a limit cycle; the noise that is drawn shakes by half of that."""


@dataclass(frozen=True, slots=True)
class Draw:
    """One sample: its seed, the profile and gains that the controller holds, and what flies it."""

    seed: int
    profile: str = "paper_40g"
    preset: str = "default"
    host: Host = Host.STUDY


@dataclass(frozen=True, slots=True)
class Sample:
    """How a draw flew. rms_m, max_m: formation error; left_fence: whether a drone was ever truly outside.

    swing_deg: at the end of a steady push.
    """

    draw: Draw
    kind: Experiment
    outcome: str
    rms_m: float
    max_m: float
    left_fence: bool
    swing_deg: float = 0.0

    @property
    def failed(self) -> bool:
        """Diverged, aborted, left the fence, or swings on in a push."""
        calm = self.swing_deg <= SWING_DEG  # NaN is none
        return self.outcome not in GOOD_RESULTS or self.left_fence or not np.isfinite(self.rms_m) or not calm


def scenario_of(draw: Draw) -> Scenario:
    """The flight that the draw's seed decides."""
    rng = np.random.default_rng([draw.seed, 5])
    kind = list(Experiment)[int(rng.integers(len(Experiment)))]
    scenario = load(SCENARIOS[kind])
    believed = profile(draw.profile)
    lab = flown_by(scenario.lab, believed, draw.preset)
    delay = rng.uniform(1.0, DELAY_MAX)
    lacks = np.random.default_rng([draw.seed, 6])
    vehicles = tuple(
        TrueVehicle(
            sysid=v.sysid,
            start=scenario.true_vehicle(v.sysid).start,
            vehicle=_vehicle(believed, delay, rng),
            inertial_rate_hz=0.0 if lacks.random() < WITHOUT_ACCELEROMETER else 100.0,
        )
        for v in lab.vehicles
        if v.sysid is not None
    )
    rate_hz = float(rng.choice(RATES_HZ))
    lab = lab.model_copy(update={"mocap": lab.mocap.model_copy(update={"rate_hz": rate_hz})})
    # A dropout while it settles in a push would be taken for its swing.
    dropout_by_s = push.BEGIN_S if kind is Experiment.PUSH else FORMATION_S - 2.0
    update: dict[str, object] = {
        "name": f"robustness_{kind}_{draw.seed}",
        "seed": draw.seed,
        "lab": lab,
        "vehicles": vehicles,
        "mocap": _mocap(scenario.mocap, rate_hz, delay, dropout_by_s, rng),
        "link": _link(scenario.link, delay),
    }
    if kind is Experiment.PUSH:
        flown = believed.model_copy(update=vehicles[0].vehicle)
        most = push.share_most(flown, lab.limits.tilt_rad)
        update |= push.push_of(lab, float(rng.uniform(0.0, most)))
    elif kind is not Experiment.GUST:
        update["formation_s"] = FORMATION_S
    return scenario.model_copy(update=update)


def fly(draw: Draw) -> Sample:
    """Fly the draw in memory and judge it."""
    result, flight = host.fly(scenario_of(draw), draw.seed, host=draw.host)
    return judge(draw, result, flight, summarise(flight))


def judge(draw: Draw, outcome: str, flight: Flight, summary: Summary) -> Sample:
    """The sample of a flight of that draw."""
    scenario = scenario_of(draw)
    kind = next(k for k in Experiment if f"_{k}_" in scenario.name)
    return Sample(
        draw,
        kind,
        outcome,
        np.nan if summary.formation_rms_m is None else summary.formation_rms_m,
        np.nan if summary.formation_max_m is None else summary.formation_max_m,
        _left_fence(flight, scenario.lab.limits.fence),
        push.settling(flight, outcome).swing_deg if kind is Experiment.PUSH else 0.0,
    )


def worst(samples: Sequence[Sample], count: int = 10) -> list[Sample]:
    """The failures first, then the largest errors."""
    return sorted(samples, key=lambda s: (not s.failed, -np.nan_to_num(s.rms_m, nan=np.inf)))[:count]


def percentile_m(samples: Sequence[Sample], percent: float) -> float:
    """Of the formation RMS over line and circle."""
    errors = [s.rms_m for s in samples if s.kind in (Experiment.LINE, Experiment.CIRCLE) and np.isfinite(s.rms_m)]
    return float(np.percentile(errors, percent)) if errors else np.nan


def _vehicle(
    believed: VehicleProfile, delay: float, rng: np.random.Generator
) -> dict[str, float | bool | tuple[float, float, float]]:
    """What one drone truly is: mass, inertia, thrust and lag off by their shares, delay longer."""

    def off(share: float) -> float:
        return float(rng.uniform(1.0 - share, 1.0 + share))

    slower = off(LAG)
    ixx, iyy, izz = (i * off(INERTIA) for i in believed.inertia_kg_m2)
    return {
        "mass_kg": believed.mass_kg * off(MASS),
        "inertia_kg_m2": (ixx, iyy, min(izz, ixx + iyy)),  # a body's, whatever was drawn
        "thrust_max_n": believed.thrust_max_n * off(CURVE),
        "thrust_curve": min(believed.thrust_curve * off(CURVE), 1.0),
        "motor_lag_s": believed.motor_lag_s * slower,
        "attitude_p_1_s": believed.attitude_p_1_s / slower,
        "rate_p_1_s": believed.rate_p_1_s / slower,
        "command_delay_s": believed.command_delay_s * delay,
    }


def _mocap(
    usual: EmulatorConfig, rate_hz: float, delay: float, dropout_by_s: float, rng: np.random.Generator
) -> EmulatorConfig:
    low, high = np.log(NOISE_M)
    noise_m = float(np.exp(rng.uniform(low, high)))
    gap = Gap(at_s=float(rng.uniform(2.0, dropout_by_s)), for_s=DROPOUT_S)
    return usual.model_copy(
        update={
            "rate_hz": rate_hz,
            "noise_m": noise_m,
            "noise_rad": NOISE_RAD_PER_M * noise_m,
            "delay_s": usual.delay_s * delay,
            "gaps": (gap,),
        }
    )


def _link(usual: LinkModel, delay: float) -> LinkModel:
    return usual.model_copy(update={"down_s": usual.down_s * delay, "up_s": usual.up_s * delay})


def _left_fence(flight: Flight, fence: Fence) -> bool:
    """Whether a drone's true position was outside while airborne."""
    low, high = np.array(fence.low_m), np.array(fence.high_m)
    aloft = flight.spans(Phase.TAKEOFF, Phase.FORMATION, Phase.HOLD, Phase.LAND)
    for truth in flight.truth.values():
        pos, stands = truth["pos_lab_m"], truth["on_ground"]
        outside: Bool = np.any((pos < low) | (pos > high), axis=-1) & ~stands
        if any(outside[(truth.t_s >= span.start_s) & (truth.t_s <= span.end_s)].any() for span in aloft):
            return True
    return False


def main(
    samples: Annotated[int, typer.Option(min=1, help="How many draws, by seeds from --first on.")] = 100,
    first: Annotated[int, typer.Option(min=0, help="The first seed.")] = 1,
    only: Annotated[int | None, typer.Option(help="Fly this one seed again, with log and report.")] = None,
    profile: Annotated[str, typer.Option(help="The vehicle the controller believes in.")] = "paper_40g",
    preset: Annotated[str, typer.Option(help="The controller.")] = "default",
    full: Full = False,
    as_json: Json = False,
    out: Annotated[Path, typer.Option(help="Where the files of --only go.")] = Path("runs"),
) -> None:
    """Fly vehicles that are not what the controller believes; the worst ten, by seed. Exit code 1 if any failed."""
    console, host = Console(stderr=as_json, markup=False), host_of(full)
    if only is not None:
        flown = [_fly_again(Draw(only, profile, preset, Host.LOCKSTEP), out, console)]
    else:
        draws = [Draw(seed, profile, preset, host) for seed in range(first, first + samples)]
        flown = Runner(console).run("flights", fly, draws)
    failures = sum(sample.failed for sample in flown)
    percentiles_m = {percent: percentile_m(flown, percent) for percent in (50.0, 95.0, 100.0)}
    if as_json:
        values = {
            "samples": [asdict(sample) | {"failed": sample.failed} for sample in flown],
            "failed": failures,
            "host": host,
            "rms_m": {f"p{percent:g}": value_m for percent, value_m in percentiles_m.items()},
        }
        print(json.dumps(without_nan(values), indent=2, allow_nan=False))
    console.print(_table(worst(flown)))
    median_mm, high_mm = 1e3 * percentiles_m[50.0], 1e3 * percentiles_m[95.0]
    console.print(f"{len(flown)} flights {flown[0].draw.host.text}, {failures} failed", highlight=False)
    console.print(f"RMS on line and circle: median {median_mm:.2f} mm, 95 % under {high_mm:.2f} mm", highlight=False)
    if failures:
        raise typer.Exit(FAILED)


def _fly_again(draw: Draw, out: Path, console: Console) -> Sample:
    """Fly one draw with a log and a report."""
    scenario = scenario_of(draw)
    log = new_folder(out / scenario.name, False) / "flight.mcap"
    flown = lockstep.run_to_file(scenario, draw.seed, log)
    flight, summary = conclude(log, flown.outcome, flown.realtime_factor)
    print_summary(summary, console)
    return judge(draw, flown.outcome.result, flight, summary)


def _table(worst: list[Sample]) -> Table:
    """The worst ten and how to fly them again."""
    table = Table(title="the worst; again with --only SEED")
    for heading in ("seed", "experiment", "outcome", "RMS, mm", "largest, mm", "swing, deg"):
        table.add_column(heading, justify="left" if heading in ("experiment", "outcome") else "right")
    for sample in worst:
        outcome = f"{sample.outcome}, left its fence" if sample.left_fence else sample.outcome
        swing = f"{sample.swing_deg:.2f}" if sample.kind is Experiment.PUSH else ""
        numbers = (f"{1e3 * sample.rms_m:.2f}", f"{1e3 * sample.max_m:.1f}", swing)
        table.add_row(str(sample.draw.seed), sample.kind, outcome, *numbers, style="red" if sample.failed else None)
    return table


if __name__ == "__main__":
    typer.run(main)
