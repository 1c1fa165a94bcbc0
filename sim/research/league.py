"""`gcs-sim league`: every law over one table of scenes and vehicles, judged by what is true of the drones.

The leader of every flight is led by the default preset, whatever law its followers fly: what differs is theirs. Each
flight is decided by its row alone, and its row holds a hash of all that was commanded, so that another machine can
check it (`check`).
"""

import hashlib
import json
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version as version_of
from itertools import pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from analysis.load import Flight
from analysis.metrics import rms
from analysis.tracking import Tracking, in_formation_phase, track
from formation.codes import GOOD_RESULTS, FlightResult
from formation.config import Fence, FollowerConfig, SlotConfig
from formation.maths.arrays import Float
from formation.messages import Phase, Verb
from formation.trajectory_config import TrajectoryConfig
from formation.vehicle.profile import VehicleProfile, profile
from sim.cameras.emulator import Gap
from sim.faults.fault import Family, Fault
from sim.research import experiments, host, neural_fly
from sim.research.experiments import Experiment, Job
from sim.research.gust import SETTLED_M, chatter_deg, pushes, settling
from sim.research.laws import ChosenLaw, followed_by
from sim.research.mismatch import Mismatch, off_by
from sim.scenario import Pose, Scenario, TrueVehicle
from sim.script import FLIGHT, Step
from wire import version
from wire.files import read_toml, sha256_of

VEHICLES = ("paper_40g", "px4_quad", "crazyflie_27g")
BUILT_IN = ("paper_smc", "paper_istsmc", "paper", "default", "pid", "geometric")
EIGHT_M, EIGHT_YAW_RAD_S = 3.0, 0.3
COARSE_M, HIDDEN_SHARE = 0.002, 0.05
PAYLOAD, LOADED_S = 1.3, (10.0, 18.0)
"""Times its own mass; from when to when in formation."""
STACKED_M, HIGH_FENCE = 1.5, Fence(low_m=(-6.0, -6.0, -0.1), high_m=(6.0, 6.0, 4.0))
SEPARATED = 1.7
"""Wheelbases off the middle, where neither is in the other's jet."""
CROSSING = (
    *FLIGHT[:-2],
    Step(verb=Verb.SHAPE, phase="FORMATION", after_s=10.0, argument="crossed"),
    Step(verb=Verb.SHAPE, phase="FORMATION", after_s=18.0, argument="configured"),
    *FLIGHT[-2:],
)
DROP_OUTS = tuple(
    Gap(at_s=at_s, for_s=0.08, body=body) for at_s, body in ((6.0, "left"), (11.0, "right"), (16.0, None))
)


class LeagueError(ValueError):
    """A result file that cannot be checked here; the text says why."""


def _circle(vehicle: VehicleProfile) -> Scenario:
    return _of(Experiment.CIRCLE, vehicle)


def _of(experiment: Experiment, vehicle: VehicleProfile) -> Scenario:
    return experiments.scenario_of(Job("cfc", experiment, 1, vehicle=vehicle))


def _eight(vehicle: VehicleProfile, speed_m_s: float) -> Scenario:
    """A figure of eight, 3 by 1.5 m, at up to that speed; the leader turns, and carries its two followers round."""
    scenario = _circle(vehicle)
    path = TrajectoryConfig(
        kind="figure8", length_m=EIGHT_M, period_s=np.pi * EIGHT_M * np.sqrt(2.0) / speed_m_s, laps=2,
        yaw_rate_rad_s=EIGHT_YAW_RAD_S,
    )  # fmt: skip
    lab = scenario.lab
    followers = tuple(
        FollowerConfig(body=f.body, sysid=f.sysid, profile=f.profile, offset_m=(-0.8, y_m, 0.0))
        for f, y_m in zip(lab.followers, (-0.8, 0.8), strict=True)
    )
    limits = lab.limits.model_copy(update={"tilt_rad": 0.8, "speed_m_s": 6.0, "fence": HIGH_FENCE})
    flight = lab.flight.model_copy(update={"altitude_m": 1.5})
    update = {"leader": lab.leader.model_copy(update={"trajectory": path}), "followers": followers, "limits": limits,
              "flight": flight}  # fmt: skip
    start = TrueVehicle(sysid=lab.leader.sysid or 0, start=Pose(pos_lab_m=(0.0, 0.0, 0.0)))
    return scenario.model_copy(update={"lab": lab.model_copy(update=update), "vehicles": (start,), "formation_s": None})


def _cameras(vehicle: VehicleProfile, lab: Mapping[str, Any], **cameras: Any) -> Scenario:
    """The circle under other cameras, of which the lab file says what is in `lab`."""
    scenario = _circle(vehicle)
    known = scenario.lab.model_copy(update={"mocap": scenario.lab.mocap.model_copy(update=lab)})
    return scenario.model_copy(update={"lab": known, "mocap": scenario.mocap.model_copy(update=cameras)})


def _loaded(vehicle: VehicleProfile) -> Scenario:
    """The circle, in which each follower is handed a payload and drops it again; the control knows of neither."""
    scenario = _circle(vehicle)
    faults = tuple(
        Fault(
            family=Family.MASS,
            severity=PAYLOAD,
            body=follower.body,
            after_s=LOADED_S[0],
            for_s=LOADED_S[1] - LOADED_S[0],
        )
        for follower in scenario.lab.followers
    )
    return scenario.model_copy(update={"faults": faults})


def _stacked(vehicle: VehicleProfile, aside: float, under: float, script: Sequence[Step] = FLIGHT) -> Scenario:
    """The circle higher up, its followers behind the leader, one lower than the other by so many wheelbases.

    aside: of each from the middle between them, wheelbases; under shape `crossed` they have exchanged their sides.
    """
    scenario, y_m, z_m = _circle(vehicle), aside * vehicle.wheelbase_m, 0.5 * under * vehicle.wheelbase_m
    lab, offsets_m = scenario.lab, ((-0.8, -y_m, z_m), (-0.8, y_m, -z_m))
    followers = tuple(f.model_copy(update={"offset_m": m}) for f, m in zip(lab.followers, offsets_m, strict=True))
    crossed = tuple(SlotConfig(offset_m=(x, -y, z)) for x, y, z in offsets_m)
    update = {
        "followers": followers,
        "formation": lab.formation.model_copy(update={"shapes": {"crossed": crossed}}),
        "limits": lab.limits.model_copy(update={"fence": HIGH_FENCE}),
        "flight": lab.flight.model_copy(update={"altitude_m": STACKED_M}),
    }
    starts = (
        TrueVehicle(sysid=f.sysid or 0, start=Pose(pos_lab_m=(-0.5, side * SEPARATED * vehicle.wheelbase_m, 0.0)))
        for f, side in zip(lab.followers, (-1.0, 1.0), strict=True)
    )
    flown = {"lab": lab.model_copy(update=update), "script": tuple(script), "vehicles": (*scenario.vehicles, *starts)}
    return scenario.model_copy(update=flown)


SCENES: Mapping[str, Callable[[VehicleProfile], Scenario]] = MappingProxyType(
    {
        "line": lambda v: _of(Experiment.LINE, v),
        "circle": _circle,
        "gust": lambda v: _of(Experiment.GUST, v),
        "push": lambda v: _of(Experiment.PUSH, v),
        "eight, 1 m/s": lambda v: _eight(v, 1.0),
        "eight, 2 m/s": lambda v: _eight(v, 2.0),
        "eight, 3 m/s": lambda v: _eight(v, 3.0),
        "payload, +30 %": lambda v: off_by(_of(Experiment.GUST, v), Mismatch(mass=PAYLOAD)),
        "payload on, off": _loaded,
        "motors, -20 %": lambda v: off_by(_of(Experiment.GUST, v), Mismatch(thrust=0.8)),
        "50 Hz": lambda v: _cameras(v, {"rate_hz": 50.0}, rate_hz=50.0),
        "30 ms later": lambda v: _cameras(v, {"delay_s": 0.038}, delay_s=0.038),
        "2 mm of noise": lambda v: _cameras(v, {}, noise_m=COARSE_M),
        "drop-outs": lambda v: _cameras(v, {}, occluded_share=HIDDEN_SHARE, gaps=DROP_OUTS),
        "one under the other": lambda v: _stacked(v, 0.0, 3.5),
        "crossing": lambda v: _stacked(v, SEPARATED, 4.2, CROSSING),
    }
)
"""The table: the paper's three and a steady push, an eight round a turning leader, a vehicle that is not as believed in
the gust, the circle under worse cameras, and a follower in the jet of the other, for good and twice in passing."""


@dataclass(frozen=True, slots=True)
class Row:
    """What is flown: one law's followers in one scene; recording: the file of the wind, of neural_fly.SCENES."""

    law: ChosenLaw
    scene: str
    vehicle: str
    seed: int = 1
    recording: str = ""


@dataclass(frozen=True, slots=True)
class Result:
    """One flight by its true states; None where it never flew in formation.

    rms_m, max_m: off the slot; outside_share: of the time, farther off it than SETTLED_M; settle_s: mean time until
    every follower stays within SETTLED_M, None where nothing begins or ends (`_calm_s`); chatter_deg:
    sim.research.gust, median follower; thrust_std: standard deviation of the thrust sent, 0..1; commands: hash of all
    targets; cpu_us: of this machine's processor for a drone and frame, simulation included, which no check compares.
    """

    outcome: str
    rms_m: float | None
    max_m: float | None
    outside_share: float | None
    settle_s: float | None
    chatter_deg: float | None
    thrust_std: float | None
    commands: str
    cpu_us: float


Tuned = Mapping[str, Mapping[str, Mapping[str, Any]]]
"""Options of own laws as `gcs-sim tune --law` writes them: by the law's label, by vehicle."""
Recorded = dict[str, dict[str, float]]
GAINS = "gains.toml"
"""Beside a law's file: options that it flies with where no others are given."""


def gains_beside(laws: Sequence[ChosenLaw]) -> Tuned:
    """The options that are tuned of those laws, each from the GAINS beside its file; ValueError, OSError."""
    files = {law.label: _file_of(law).with_name(GAINS) for law in laws if law.is_file}
    return {label: read_toml(file).get(label, {}) for label, file in files.items() if file.is_file()}


def rows(
    laws: Sequence[ChosenLaw],
    scenes: Sequence[str],
    vehicles: Sequence[str],
    tuned: Tuned = MappingProxyType({}),
    recordings: Path | None = None,
) -> list[Row]:
    """Every law in every scene, or in all, neural_fly.SCENES among them where there are recordings; ValueError."""
    labels = [law.label for law in laws]
    if twice := {label for label in labels if labels.count(label) > 1}:
        raise ValueError(f"two laws are called {min(twice)}: a table needs a name for each")
    known = (*SCENES, *(neural_fly.SCENES if recordings is not None else ()))
    wanted = scenes or known
    if unknown := set(wanted) - set(known):
        raise ValueError(f"unknown scene {min(unknown)!r}; known: {', '.join(known)}")

    def of(law: ChosenLaw, vehicle: str) -> ChosenLaw:
        options = tuned.get(law.label, {}).get(vehicle)
        return law if options is None or law.is_preset else replace(law, law=tuple(options.items()))

    flown = [(vehicle, scene, "") for vehicle in vehicles for scene in wanted if scene in SCENES]
    for scene in wanted:
        if recordings is not None and scene in neural_fly.SCENES:
            flown.append((neural_fly.VEHICLE.name, scene, str(neural_fly.pushed_by(recordings, scene))))
    return [
        Row(of(law, vehicle), scene, vehicle, recording=recording)
        for vehicle, scene, recording in flown
        for law in laws
    ]


def _scene(row: Row) -> tuple[Scenario, Float]:
    """What is flown, and the wind from when the leader moves; BadFileError, a ValueError."""
    if not row.recording:
        return SCENES[row.scene](profile(row.vehicle)), host.STILL
    recording = neural_fly.read(Path(row.recording))
    return neural_fly.scenario_of(recording), neural_fly.wind(recording, host.GUST_NS * 1e-9)


def fly(row: Row) -> Result:
    """Fly one row and measure it."""
    scenario, wind = _scene(row)
    lab = row.law.lab(scenario.lab)
    began_s = time.process_time()
    outcome, flight = host.fly(
        scenario.model_copy(update={"lab": lab}), row.seed, followed_by(row.law, scenario.lab), own=row.law.own(lab),
        wind=wind,
    )  # fmt: skip
    took_s = time.process_time() - began_s
    return _measured(row, scenario, outcome, flight, took_s)


def _calm_s(scenario: Scenario, flight: Flight) -> list[tuple[float, float]]:
    """From when to when a follower has time to settle: from a payload's coming to its going, from its going on, from
    the end of each push of the fan to the next, and from the beginning of a push that stays."""
    formed, fan = flight.spans(Phase.FORMATION), scenario.air.fan
    if not formed:
        return []
    begin_s, end_s = formed[0].start_s, formed[0].end_s
    changes_s = {begin_s + fault.after_s + s for fault in scenario.faults for s in (0.0, fault.for_s or 0.0)}
    if fan is not None and fan.sweep_rad:
        truth = flight.truth[scenario.lab.followers[0].sysid or 0]
        blown = (truth.t_s >= fan.start_s) & (truth.t_s <= end_s)
        t_s, push = truth.t_s[blown], np.linalg.norm(truth["dist_lab_m_s2"][blown], axis=-1)
        return [(float(t_s[end]), float(t_s[after - 1])) for _, end, after in pushes(push)] if len(push) else []
    if fan is not None:
        changes_s.add(fan.start_s)
    return list(pairwise([*sorted(t_s for t_s in changes_s if t_s < end_s), end_s]))


def _settle_s(tracking: Tracking, calm_s: Sequence[tuple[float, float]]) -> float | None:
    """Mean time in them until every follower stays within SETTLED_M of its slot."""
    off_m = np.where(tracking.scored, np.linalg.norm(tracking.error_lead_m, axis=-1), 0.0).max(axis=1, initial=0.0)
    at = np.searchsorted(tracking.t_s, calm_s)
    return settling(tracking.t_s, off_m, [(begin, begin, end) for begin, end in at.tolist()]) if len(at) else None


def _measured(row: Row, scenario: Scenario, outcome: str, flight: Flight, took_s: float) -> Result:
    turns = max(len(flight.target) * len(flight.vehicles), 1)
    tracking = track(true(flight))
    counted = tracking.scored
    if any(step.verb is Verb.SHAPE for step in scenario.script):  # then the change of shape is what is flown
        counted = tracking.formed & np.logical_or.accumulate(counted, axis=0)
    scored = counted & (tracking.t_s >= _judged_from_s(row, flight))[:, None]
    error_m = np.linalg.norm(tracking.error_lead_m, axis=-1)[scored]
    formed = in_formation_phase(flight, flight.target.t_s)
    columns = [v.column for v in flight.followers if v.column is not None]
    q, rate, thrust = (flight.target[name][formed] for name in ("q_lab_from_flu", "rate_flu_rad_s", "thrust_norm"))
    lab = flight.run.lab
    gain_1_s = 1.0 if lab is None else lab.profile_of(lab.followers[0]).attitude_p_1_s
    moved = [chatter_deg(q[:, c], rate[:, c], gain_1_s) for c in columns] if formed.any() else []
    if len(flight.law_failures):
        hashed, cpu_us = commands_hash(flight), 1e6 * took_s / turns
        return Result(FlightResult.LAW_FAILED, None, None, None, None, None, None, hashed, cpu_us)
    return Result(
        str(outcome),
        rms(error_m),
        float(error_m.max()) if error_m.size else None,
        float(np.mean(error_m > SETTLED_M)) if error_m.size else None,
        _settle_s(tracking, _calm_s(scenario, flight)),
        float(np.median(moved)) if moved else None,
        float(thrust[:, columns].std(axis=0).mean()) if formed.any() else None,
        commands_hash(flight),
        1e6 * took_s / turns,
    )


def _judged_from_s(row: Row, flight: Flight) -> float:
    """From the first frame on; in a recorded wind as the article does, SETTLED_S after it begins."""
    if not row.recording:
        return 0.0
    truth = flight.truth[neural_fly.FOLLOWER_SYSID]
    return float(truth.t_s[truth["dist_lab_m_s2"].any(axis=-1).argmax()]) + neural_fly.SETTLED_S


def true(flight: Flight) -> Flight:
    """The flight as it was, not as the cameras saw it: a simulator's truth in the place of the poses that it has."""
    poses = flight.poses
    pos, q, seen = poses.pos_lab_m.copy(), poses.q_lab_from_flu.copy(), poses.seen.copy()
    for i, vehicle in enumerate(flight.vehicles):
        truth = flight.truth.get(vehicle.sysid or 0)
        if truth is None:
            continue
        at = np.clip(np.searchsorted(truth.t_s, poses.t_s - 5e-4), 0, len(truth) - 1)
        pos[:, i], q[:, i], seen[:, i] = truth["pos_lab_m"][at], truth["q_lab_from_flu"][at], True
    return replace(flight, poses=replace(poses, pos_lab_m=pos, q_lab_from_flu=q, seen=seen))


def commands_hash(flight: Flight) -> str:
    """SHA-256 of every target, in order: attitude, rates and thrust, in single precision as they are sent."""
    digest = hashlib.sha256()
    for name in ("q_lab_from_flu", "rate_flu_rad_s", "thrust_norm"):
        digest.update(np.ascontiguousarray(flight.target[name], "<f4").tobytes())
    return digest.hexdigest()


def cost(result: Result) -> float:
    """Its RMS, m; infinite where it did not fly to its end."""
    return result.rms_m if result.outcome in GOOD_RESULTS and result.rms_m is not None else np.inf


def to_json(flown: Sequence[tuple[Row, Result]], recorded_m: Recorded | None = None) -> str:
    """The result file: versions, the laws with the hashes of their files, the RMS of recorded flights by method and
    scene, and a row a flight."""
    laws = {
        row.law.label: {"name": row.law.name, "sha256": sha256_of(_file_of(row.law)) if row.law.is_file else ""}
        for row, _ in flown
    }
    table = [
        {
            "law": row.law.label,
            "options": dict(row.law.law),
            "scene": row.scene,
            "vehicle": row.vehicle,
            "seed": row.seed,
            "recording": sha256_of(Path(row.recording)) if row.recording else "",
        }
        | asdict(result)
        for row, result in flown
    ]
    facts = {"versions": versions(), "laws": laws, "recorded_rms_m": recorded_m or {}}
    return json.dumps(facts | {"rows": table}, indent=1, allow_nan=False)


def versions() -> dict[str, str]:
    """What decides a flight's bits, and what may."""
    packages = {name: version_of(name) for name in ("numpy", "numba", "scipy")}
    return {"mavlink-formation": version.VERSION, "commit": version.commit(), "python": platform.python_version(),
            "machine": platform.machine()} | packages  # fmt: skip


def _file_of(law: ChosenLaw) -> Path:
    return Path(law.name.partition(":")[0])


def known_rows(text: str, source: str, recordings: Path | None = None) -> list[tuple[Row, Result]]:
    """The rows of a result file whose laws, and recordings, are here, as they were there; LeagueError."""
    try:
        values = json.loads(text)
        laws = {label: _law(label, entry) for label, entry in values["laws"].items()}
        return [_known_row(laws, each, recordings) for each in values["rows"]]
    except (json.JSONDecodeError, KeyError, TypeError) as error:
        raise LeagueError(f"{source}: no result file of a league: {type(error).__name__}: {error}") from error


def _known_row(laws: Mapping[str, ChosenLaw], entry: Mapping[str, Any], recordings: Path | None) -> tuple[Row, Result]:
    law = replace(laws[entry["law"]], law=tuple(entry["options"].items()))
    result = Result(**{name: entry[name] for name in Result.__dataclass_fields__})
    scene, file = entry["scene"], ""
    if wanted := entry["recording"]:
        if recordings is None:
            raise LeagueError(f"{scene}: its recording is yours to fetch; --neural-fly DIR says where it is")
        file = str(_the_same(neural_fly.pushed_by(recordings, scene), wanted, scene))
    return Row(law, scene, entry["vehicle"], entry["seed"], file), result


def _law(label: str, entry: Mapping[str, Any]) -> ChosenLaw:
    law = ChosenLaw(str(entry["name"]))
    if law.is_file:
        _the_same(_file_of(law), entry["sha256"], label)
    return law


def _the_same(file: Path, sha256: str, of: str) -> Path:
    """The file that was flown with; LeagueError where it is another."""
    if not file.is_file():
        raise LeagueError(f"{of}: its file {file} is not here")
    found = sha256_of(file)
    if found != sha256:
        raise LeagueError(f"{of}: {file} is another file: its SHA-256 is {found}, flown was {sha256}")
    return file


def differences(there: Result, here: Result) -> list[str]:
    """What is not the same to the bit, in words; time is not compared."""
    was, now = asdict(there), asdict(here)
    return [f"{key} {was[key]} there, {now[key]} here" for key in was if key != "cpu_us" and was[key] != now[key]]
