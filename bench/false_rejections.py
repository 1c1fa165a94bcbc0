"""How often the pose validator rejects correct poses: flights and aggressive motion, replayed under ever new noise.

A flight is flown once; its true poses then go through MocapCore again and again, each time with other noise, delays,
lost frames and hidden bodies. Any rejection is a false one.
"""

import json
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console

from bench.command import FAILED, Json
from bench.robustness import NOISE_M
from formation import topics
from formation.config import LabConfig
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.messages import Phase, RawFrame
from formation.safety.phases import AIRBORNE
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PROFILES
from mocap.core import MocapCore
from mocap.sources.csv_file import read_recording
from sim.faults.poses import NOISE_RAD_PER_M
from sim.lockstep import run_in_memory
from sim.runner import Runner
from sim.scenario import load, with_leader_file
from sim.shipped import shipped

AGGRESSIVE = "aggressive"
PERIOD_NS = 10_000_000
DELAY_NS = 8_000_000
HIDDEN_SHARE, LOST_SHARE, GAP_EVERY_S, GAP_S = 0.01, 0.01, 20.0, (0.03, 0.5)
WAVES, AGGRESSIVE_S, ACC_M_S2, SHRINKS = 4, 60.0, 14.0, 5
VEHICLES = ("paper_40g", "px4_quad", "arducopter_quad")


@dataclass(frozen=True, slots=True)
class Job:
    """What is replayed for how long: a shipped scenario, a CSV recording of a leader, or AGGRESSIVE."""

    source: str
    seconds: float
    seed: int = 1


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """True poses in lab and flu, (k, n, ...), at their exposures (k,); which drones are armed, (k,).

    noisy (n): whether the cameras' noise is still to come.
    """

    lab: LabConfig
    t_ns: NDArray[np.int64]
    pos_lab_m: Float
    q_lab_from_flu: Float
    armed: Bool
    noisy: Bool


@dataclass(frozen=True, slots=True)
class Judged:
    """What came of a job; rejected: by body and check, with the seed of the replay."""

    source: str
    seconds: float
    poses: int
    rejected: tuple[str, ...]


def judge(job: Job) -> Judged:
    """Fly, or make, the job's motion once, and replay it until its time is over."""
    flown_s, poses, rejected, seed = 0.0, 0, list[str](), job.seed
    motion = motion_of(job.source, job.seed)
    while flown_s < job.seconds:
        count, found = replay(motion, seed)
        flown_s, poses = flown_s + float(motion.t_ns[-1] - motion.t_ns[0]) * 1e-9, poses + count
        rejected += [f"{job.source}, seed {seed}: {text}" for text in found]
        seed += 1
        if job.source == AGGRESSIVE:
            motion = aggressive(seed)
    return Judged(job.source, flown_s, poses, tuple(rejected))


def motion_of(source: str, seed: int) -> Motion:
    """The motion of a job's source."""
    if source == AGGRESSIVE:
        return aggressive(seed)
    return recorded(Path(source)) if source.endswith(".csv") else flown(source)


def replay(motion: Motion, seed: int) -> tuple[int, list[str]]:
    """One pass through a MocapCore: how many poses it was shown, and what it rejected, or took to be exchanged."""
    rng = np.random.default_rng(seed)
    core, raws = MocapCore(motion.lab), _raw_frames(motion, rng)
    arrivals = motion.t_ns + DELAY_NS + rng.exponential(500_000.0, len(motion.t_ns)).astype(np.int64)
    drones = [v.body for v in motion.lab.vehicles if v.sysid is not None]
    delivered, shown = (rng.random(len(raws)) >= LOST_SHARE) & ~_in_gaps(motion.t_ns, rng), 0
    for k in np.flatnonzero(delivered):
        core.note_motors(dict.fromkeys(drones, bool(motion.armed[k])))
        core.receive(raws[k], int(arrivals[k]))
        shown += int(raws[k].seen.sum())
    rejected = [f"{body}: {count} x {name}" for body, by in core.rejections().items() for name, count in by.items()]
    texts = [event.text for event in core.events(int(arrivals[-1]) + 10**10)]
    return shown, rejected + [text for text in texts if "swapped" in text]


def _in_gaps(t_ns: NDArray[np.int64], rng: np.random.Generator) -> NDArray[np.bool_]:
    """Which exposures lie in a gap of GAP_S; there is one every GAP_EVERY_S or so."""
    t_s, gaps = (t_ns - t_ns[0]) * 1e-9, np.zeros(len(t_ns), np.bool_)
    for begin_s in rng.uniform(0.0, t_s[-1], rng.poisson(t_s[-1] / GAP_EVERY_S)):
        gaps |= (t_s >= begin_s) & (t_s < begin_s + rng.uniform(*GAP_S))
    return gaps


def flown(name: str) -> Motion:
    """A shipped scenario's flight in lockstep; the leader that no drone carries as its cameras showed it."""
    scenario = load(name)
    _, records = run_in_memory(scenario, scenario.seed)
    lab = scenario.lab
    index_of = {v.sysid: i for i, v in enumerate(lab.vehicles)}
    shown = {e.message.t_capture_ns: e.message for e in records if e.topic is topics.MOCAP}
    t_ns = np.array(sorted(shown), np.int64)
    at = {int(t): k for k, t in enumerate(t_ns)}
    pos = np.stack([shown[int(t)].pos_lab_m for t in t_ns])
    q = np.stack([shown[int(t)].q_lab_from_flu for t in t_ns])
    for entry in records:
        if entry.topic is topics.TRUTH and entry.message.t_ns in at:
            k, i = at[entry.message.t_ns], index_of[entry.message.sysid]
            pos[k, i], q[k, i] = entry.message.pos_lab_m, entry.message.q_lab_from_flu
    changes = [(e.t_ns, e.message.phase) for e in records if e.topic is topics.PHASE]
    phase = np.searchsorted([t for t, _ in changes], t_ns, side="right") - 1
    armed = np.array([changes[max(i, 0)][1] in AIRBORNE | {Phase.ARMED} for i in phase])
    return Motion(lab, t_ns, pos, q, armed, np.array([v.sysid is not None for v in lab.vehicles]))


def recorded(file: Path) -> Motion:
    """A recorded leader before drones that are armed and never seen; it brings its own noise."""
    scenario = with_leader_file(load("vicon_leader"), str(file))
    lab, poses = scenario.lab, read_recording(file)
    k, n = len(poses.t_ns), len(lab.vehicles)
    pos, q = np.full((k, n, 3), np.nan), np.tile(frames.IDENTITY, (k, n, 1))
    pos[:, 0], q[:, 0] = poses.pos_mocap_m, poses.q_mocap_from_marker
    return Motion(lab, poses.t_ns + 10**9, pos, q, np.ones(k, np.bool_), np.zeros(n, np.bool_))


def aggressive(seed: int) -> Motion:
    """Drones of every shipped vehicle thrown about: waves of acceleration up to 14 m/s², attitude along the thrust.

    Each turns as fast as its own rate limit lets it, no faster, and yaws at up to its yaw rate.
    """
    rng, n = np.random.default_rng([seed, 9]), 2 * len(VEHICLES)
    t_ns = 10**9 + np.arange(round(AGGRESSIVE_S * 1e9 / PERIOD_NS)) * PERIOD_NS
    t_s = 1e-9 * t_ns[:, None, None, None]
    names = [VEHICLES[i % len(VEHICLES)] for i in range(n)]
    w = 2.0 * np.pi * rng.uniform(0.4, 1.2, (n, 3, WAVES))
    size = rng.dirichlet(np.ones(WAVES), (n, 3)) * ACC_M_S2 * np.array([1.0, 1.0, 0.4])[:, None]
    wave = np.sin(w * t_s + rng.uniform(0.0, 2.0 * np.pi, w.shape))
    fastest = np.array([PROFILES[name].rate_max_rad_s for name in names])
    share = np.ones(n)
    for _ in range(SHRINKS):
        q = _along_thrust((share[:, None, None] * size * wave).sum(axis=-1))
        share *= np.minimum(1.0, fastest / _rates(q).max(axis=0))
    size *= share[:, None, None]
    q = _along_thrust((size * wave).sum(axis=-1))
    pos = 5.0 * np.arange(n)[:, None] * np.array([1.0, 0.0, 0.0]) - (size / w**2 * wave).sum(axis=-1)
    turn = rng.uniform(1.0, 3.0, n)
    yaw = np.array([PROFILES[name].rate_yaw_max_rad_s for name in names]) / turn * np.sin(turn * t_s[..., 0, 0])
    q = frames.canonical(frames.multiply(q, frames.from_yaw(yaw)))
    vehicles = [{"body": f"b{i}", "sysid": i + 1, "profile": name} for i, name in enumerate(names)]
    followers = [{**vehicle, "offset_m": (0, i, 0)} for i, vehicle in enumerate(vehicles)][1:]
    lab = LabConfig.model_validate({"leader": vehicles[0], "followers": followers})
    return Motion(lab, t_ns, pos, q, np.ones(len(t_ns), np.bool_), np.ones(n, np.bool_))


def _along_thrust(acc_lab_m_s2: Float) -> Float:
    """Attitudes, without yaw, whose z axis is along the thrust that makes the acceleration; (..., 3) -> (..., 4)."""
    z = acc_lab_m_s2 + np.array([0.0, 0.0, GRAVITY_M_S2])
    z /= np.linalg.norm(z, axis=-1, keepdims=True)
    half = np.concatenate([1.0 + z[..., 2:], np.stack([-z[..., 1], z[..., 0], 0.0 * z[..., 0]], axis=-1)], axis=-1)
    return frames.canonical(half)


def _rates(q: Float) -> Float:
    """How fast the attitudes (k, n, 4) turn from one exposure to the next, rad/s."""
    cosine = np.abs((q[1:] * q[:-1]).sum(axis=-1))
    rates: Float = 2.0 * np.arccos(np.minimum(cosine, 1.0)) / (PERIOD_NS * 1e-9)
    return rates


def jobs(hours: float, scenarios: tuple[str, ...], recording: Path | None) -> list[Job]:
    """The time shared out evenly; the recording once, at least."""
    sources = [*scenarios, AGGRESSIVE, *([] if recording is None else [str(recording)])]
    return [Job(source, 3600.0 * hours / len(sources)) for source in sources]


def totals(judged: list[Judged]) -> Counter[str]:
    """Seconds, poses and false rejections together."""
    return Counter(
        seconds=round(sum(j.seconds for j in judged)),
        poses=sum(j.poses for j in judged),
        rejected=sum(len(j.rejected) for j in judged),
    )


def _raw_frames(motion: Motion, rng: np.random.Generator) -> list[RawFrame]:
    """The motion as the cameras report it, in their axes, with noise; some bodies hidden for one frame or more."""
    k, n = motion.pos_lab_m.shape[:2]
    noise_m = float(np.exp(rng.uniform(*np.log(NOISE_M))))
    noise_std_m = motion.noisy[:, None] * noise_m
    pos = motion.pos_lab_m + noise_std_m * rng.standard_normal((k, n, 3))
    small = np.ones((k, n, 4))
    small[..., 1:] = 0.5 * NOISE_RAD_PER_M * noise_std_m * rng.standard_normal((k, n, 3))
    q = frames.multiply(motion.q_lab_from_flu, frames.canonical(small))
    seen = (rng.random((k, n)) >= HIDDEN_SHARE) & np.isfinite(motion.pos_lab_m).all(axis=-1)
    for i in range(n):
        seen[_in_gaps(motion.t_ns, rng), i] = False
    mocap, bodies = motion.lab.mocap, tuple(v.body for v in motion.lab.vehicles)
    q_mocap_from_lab = frames.inverse(np.array(mocap.q_lab_from_mocap))
    q_flu_from_marker = frames.inverse(np.array([v.q_marker_from_flu for v in motion.lab.vehicles]))
    pos = frames.rotate(q_mocap_from_lab, pos - np.array(mocap.origin_lab_m))
    q = frames.multiply(frames.multiply(q_mocap_from_lab, q), q_flu_from_marker)
    return [RawFrame(at, int(t), bodies, pos[at], q[at], seen[at]) for at, t in enumerate(motion.t_ns)]


def main(
    hours: Annotated[float, typer.Option(min=0.001, help="Hours of flight, over all sources together.")] = 10.0,
    leader_csv: Annotated[Path | None, typer.Option(help="A recorded leader to replay as well (CSV).")] = None,
    as_json: Json = False,
) -> None:
    """Count the pose validator's false rejections: every shipped scenario, and aggressive motion, under ever new noise.

    Exit code 1 if there was any.
    """
    console = Console(stderr=as_json, markup=False)
    scenarios = tuple(name for name in shipped() if not load(name).needs_leader_file)
    judged = Runner(console).run("sources", judge, jobs(hours, scenarios, leader_csv))
    for one in judged:
        console.print(f"{one.seconds / 3600.0:6.2f} h {one.poses:10d} poses  {one.source}", highlight=False)
        for text in one.rejected:
            console.print(text, style="red", highlight=False)
    found = totals(judged)
    if as_json:
        print(json.dumps({"totals": found, "sources": [asdict(one) for one in judged]}, indent=2))
    flown_h = found["seconds"] / 3600.0
    console.print(f"{flown_h:.1f} h, {found['poses']} poses, {found['rejected']} rejected falsely", highlight=False)
    if found["rejected"]:
        raise typer.Exit(FAILED)


if __name__ == "__main__":
    typer.run(main)
