"""How well `gcs-log whatif` predicts: law B in a wind, foretold from the log of law A in that wind alone.

    python -m bench.whatif --out runs/whatif.jsonl [--neural-fly DIR]

Thirty pairs: five laws, six winds, two vehicles; or ten, in the force that Neural-Fly's flights recorded. A and B are
each flown in lockstep, with MAVLink, guards and simulated autopilots; of A's flight whatif is given the log alone. A
pair that is in the file already is not flown again.
"""

import json
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from analysis.load import Flight, from_records
from analysis.metrics import summarise
from bench.command import FAILED
from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.attitude_loop import OWN, WHOLE_MOTORS, Physics, advance
from drone_agent.simulation.disturbance import Disturbance
from formation import topics
from formation.codes import GOOD_RESULTS
from formation.maths.arrays import Float
from formation.topics import Topic
from formation.vehicle.profile import VehicleProfile, VehicleState, profile
from sim import lockstep
from sim.research import neural_fly
from sim.research.laws import chosen
from sim.research.neural_fly import Recording
from sim.research.reflight import Change
from sim.research.whatif import what_if
from sim.scenario import Scenario, flown_by, load, with_leader_file
from sim.world import T0_NS
from wire.logs.mcap_read import Entry

LAWS = ("default", "paper", "pid", "geometric", "paper_istsmc")
WINDS = ("fan", "steady", "steps", "sines", "gusty", "gusty, led")
VEHICLES = ("paper_40g", "px4_quad")
LED = ", led"
"""The leader, a body that no drone carries and no wind moves, goes round a circle."""
WITHIN, ENOUGH_SHARE = 0.15, 25 / 30
BEGINS_S, WIND_HZ, FORMATION_S = 12.0, 200.0, 24.0
GUST_S, GUST_M_S2 = 0.5, 1.0


@dataclass(frozen=True, slots=True)
class Pair:
    """Law B in a wind is foretold from the flight of law A in it."""

    a: str
    b: str
    wind: str
    vehicle: str


@dataclass(frozen=True, slots=True)
class Judged:
    """A pair's numbers: RMS of A and of B as flown, of B as foretold, m; how far A came back; what trust was said."""

    pair: Pair
    a_rms_m: float
    b_rms_m: float
    foretold_m: float
    back_share: float
    leaves: tuple[str, ...]

    @property
    def missed(self) -> float:
        """By which share of B's own RMS it was foretold wrong."""
        return self.foretold_m / self.b_rms_m - 1.0


class Blown:
    """A push of a time, the same on every drone, on top of the scenario's air."""

    def __init__(self, wind: str, recording: Recording | None = None) -> None:
        self._now_s, self._wind, self._recording = 0.0, wind, recording

    def receive(self, t_ns: int) -> None:
        """The flight is there now."""
        self._now_s = (t_ns - T0_NS) * 1e-9

    @cached_property
    def _table(self) -> Float:
        """(K, 3), m/s^2, WIND_HZ a second from BEGINS_S on."""
        if self._recording is not None:
            return neural_fly.wind(self._recording, 1.0 / WIND_HZ)[:, 1]
        t_s = np.arange(0.0, 60.0, 1.0 / WIND_HZ)
        nothing = np.zeros_like(t_s)
        match self._wind:
            case "steady":
                return np.stack([-1.5 * (t_s > 0.5), nothing, nothing], axis=1)
            case "steps":
                return np.stack([1.0 * ((t_s % 4.0) > 2.0), -0.7 * ((t_s % 6.0) > 3.0), nothing], axis=1)
            case "sines":
                return np.stack(
                    [1.2 * np.sin(2.0 * np.pi * 0.3 * t_s), 0.8 * np.sin(2.0 * np.pi * 0.9 * t_s), nothing], axis=1
                )
            case "fan":
                return np.zeros((1, 3))
            case _:  # a first-order Gauss-Markov process, as Dryden's along the wind
                keep = float(np.exp(-1.0 / (WIND_HZ * GUST_S)))
                drawn = np.random.default_rng(7).standard_normal((len(t_s), 3)) * GUST_M_S2 * np.sqrt(1.0 - keep**2)
                drawn[:, 2] *= 0.3
                push = np.zeros((len(t_s), 3))
                for k in range(1, len(t_s)):
                    push[k] = keep * push[k - 1] + drawn[k]
                return push

    def advance(
        self, state: VehicleState, profile: VehicleProfile, setpoint: LoopSetpoint, armed: bool, dist_lab_m_s2: Float,
        dt_s: float, steps: int, thrust_scale: float = 1.0, motor_gain: Float = WHOLE_MOTORS,
    ) -> VehicleState:  # fmt: skip
        """As drone_agent.simulation.attitude_loop.advance, in this wind."""
        k = int((self._now_s - BEGINS_S) * WIND_HZ)
        leads = self._recording is not None and profile.name != neural_fly.VEHICLE.name
        push = self._table[k] if 0 <= k < len(self._table) and not leads else 0.0
        return advance(state, profile, setpoint, armed, dist_lab_m_s2 + push, dt_s, steps, thrust_scale, motor_gain)


def pairs(recorded: bool = False) -> list[Pair]:
    """Every law in every wind foretells another law, the vehicles by turns; or two laws in every recorded wind."""
    if recorded:
        vehicle, winds = neural_fly.VEHICLE.name, tuple(neural_fly.SCENES)
        return [
            Pair(LAWS[k % 5], LAWS[(k + 1 + k // 5) % 5], winds[k % len(winds)], vehicle) for k in range(2 * len(winds))
        ]
    return [
        Pair(a, LAWS[(i + 1 + j % 4) % len(LAWS)], wind, VEHICLES[(i + j) % 2])
        for i, a in enumerate(LAWS)
        for j, wind in enumerate(WINDS)
    ]


def scenario_of(law: str, wind: str, vehicle: str, leader: Path, recording: Recording | None = None) -> Scenario:
    """One drone beside a leader that stands, goes as recorded in that file, or flies the recorded figure of eight."""
    if recording is not None:
        eight = neural_fly.scenario_of(recording)
        return eight.model_copy(update={"lab": chosen(law).lab(eight.lab)})
    scenario = load("hover_gust")
    update: dict[str, object] = {"lab": flown_by(scenario.lab, profile(vehicle), law), "formation_s": FORMATION_S}
    if wind != "fan":
        update["air"] = Disturbance()
    scenario = scenario.model_copy(update=update)
    return with_leader_file(scenario, str(leader)) if wind.endswith(LED) else scenario


def write_circle(path: Path) -> None:
    """A leader's recording: 0.3 m about (0, 0.8, 0.3) in 8 s."""
    t_s = np.arange(0.0, 40.0, 0.01)
    angle = 2.0 * np.pi * t_s / 8.0
    rows = (
        f"{t:.2f},{0.3 * np.cos(a):.6f},{0.8 + 0.3 * np.sin(a):.6f},0.3,1,0,0,0"
        for t, a in zip(t_s, angle, strict=True)
    )
    path.write_text("\n".join(("t [s],x [m],y [m],z [m],qw,qx,qy,qz", *rows)), encoding="utf-8")


def fly(law: str, wind: str, vehicle: str, seed: int, recordings: Path | None = None) -> Flight:
    """One flight in lockstep, as it would be loaded from its log, without the simulator's truth."""
    recording = None if recordings is None else neural_fly.read(neural_fly.pushed_by(recordings, wind))
    blown, records = Blown(wind, recording), list[Entry]()

    def record(topic: Topic, message: object, t_ns: int) -> None:
        blown.receive(t_ns)
        if topic is not topics.TRUTH:
            records.append(Entry(topic, t_ns, message))

    with TemporaryDirectory() as folder:
        circle = Path(folder) / "circle.csv"
        write_circle(circle)
        scenario = scenario_of(law, wind, vehicle, circle, recording)
        lockstep.fly(scenario, seed, record, physics=Physics(OWN.step_ns, blown.advance))
    return from_records(lockstep.metadata(scenario, seed, "memory", T0_NS), records)


def judge(pair: Pair, recordings: Path | None = None) -> Judged:
    """Fly A and B, B by another seed, and foretell B."""
    a, b = (fly(law, pair.wind, pair.vehicle, seed, recordings) for law, seed in ((pair.a, 1), (pair.b, 2)))
    foretold = what_if(a, Change(chosen(pair.b)), "a")
    ended = () if foretold.result in GOOD_RESULTS else (f"ended by a rule: {foretold.result}",)
    leaves = (*ended, *(text for trust in foretold.trust for text in trust.leaves))
    a_rms_m, b_rms_m, foretold_m = (
        np.nan if summary.formation_rms_m is None else summary.formation_rms_m
        for summary in (summarise(a), summarise(b), foretold.other.summary)
    )
    return Judged(pair, a_rms_m, b_rms_m, foretold_m, foretold.back_share, leaves)


def main(
    out: Annotated[Path, typer.Option(help="Results, a line a pair; those there are not flown again.")] = Path(
        "whatif.jsonl"
    ),
    most: Annotated[int, typer.Option(min=0, help="Fly so many pairs more at most.")] = 1000,
    recordings: Annotated[
        Path | None, typer.Option("--neural-fly", help="Folder of custom_figure8_*.csv (aerorobotics/neural-fly).")
    ] = None,
) -> None:
    """Predict 30 flights, or 10 in recorded wind; exit code 1 where fewer than 25 of 30 are within 15 %."""
    wanted = pairs(recorded=recordings is not None)
    lines = out.read_text(encoding="utf-8").splitlines() if out.exists() else []
    rows = [json.loads(line) for line in lines]
    known = {
        Pair(**row["pair"]): Judged(**row | {"pair": Pair(**row["pair"]), "leaves": tuple(row["leaves"])})
        for row in rows
    }
    for pair in [each for each in wanted if each not in known][:most]:
        known[pair] = judge(pair, recordings)
        with out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(known[pair])) + "\n")
        typer.echo(f"{pair}: {100 * known[pair].missed:+.1f} %", err=True)
    judged = [known[pair] for pair in wanted if pair in known]
    Console().print(table(judged))
    good = sum(abs(each.missed) <= WITHIN for each in judged)
    typer.echo(f"{good} of {len(judged)} within {100 * WITHIN:.0f} %")
    if good < ENOUGH_SHARE * len(wanted):
        raise typer.Exit(FAILED)


def table(judged: list[Judged]) -> Table:
    """A row a pair."""
    shown = Table(title="law B foretold from the log of law A: RMS, mm")
    for heading in ("vehicle", "wind", "A", "B", "A flown", "A again", "B foretold", "B flown", "off"):
        shown.add_column(heading, justify="left" if heading in ("vehicle", "wind", "A", "B") else "right")
    for each in judged:
        pair, missed = each.pair, each.missed
        numbers = (each.a_rms_m, each.a_rms_m * (1.0 + each.back_share), each.foretold_m, each.b_rms_m)
        shown.add_row(pair.vehicle, pair.wind, pair.a, pair.b, *(f"{1e3 * n:.3g}" for n in numbers),
                      f"{100 * missed:+.1f} %", style="red" if abs(missed) > WITHIN else None)  # fmt: skip
    return shown


if __name__ == "__main__":
    typer.run(main)
