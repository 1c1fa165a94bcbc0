"""`python -m bench.soak`: a long hover, or one of many drones, its log written: what memory and log grow by meanwhile.

In lockstep everything runs in this one process, so that what grows is an upper bound for the ground alone. By real
processes the memory is the ground's own, its late control cycles are counted, and its tick is timed: from the receipt
of a frame until the last drone's datagram was handed to Zenoh. How near the drones came to each other is judged.
"""

import asyncio
import json
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from bench.command import FAILED, Json
from bench.timings import Timing, of_size
from formation.messages import Phase, Verb
from formation.requests import GCS_NAME
from formation.safety.phases import AIRBORNE
from formation.safety.rules import nearest
from formation.topics import MOCAP, PHASE, TIMING
from formation.trajectory_config import TrajectoryConfig
from sim.fly import Files, fly_on, running
from sim.lockstep import run_to_file
from sim.ports import private_link
from sim.scenario import Scenario
from sim.script import Step
from wire.clock import REAL_TIME, Clock
from wire.files import recorded
from wire.ground_state import Cycles, decode
from wire.logs.mcap_read import read_log

SAMPLED_S, SEPARATION_NS = 5.0, 100_000_000
LANDING_S = 60.0
"""After the hover: for take-off, landing and what the drones' autopilots take to disarm."""
CAPACITY_MAH = 1e6
"""Of each battery: the flight ends for no low one."""
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Sample:
    """The state of the process at a time of the flight; cycles: of control, late: of these."""

    t_s: float
    memory_bytes: int
    log_bytes: int
    cycles: int = 0
    late: int = 0


@dataclass(frozen=True, slots=True)
class Soak:
    """A hover of so many drones; samples: in the air, SAMPLED_S apart; outcome: how it ended.

    speed: simulated seconds a second. tick: of the ground with a frame, in the air; None in lockstep. separation_m: the
    least between two in the air, sampled ten times a second, None where nobody took off; min_separation_m: of the lab.
    """

    drones: int
    samples: tuple[Sample, ...]
    outcome: str
    speed: float
    tick: Timing | None = None
    separation_m: float | None = None
    min_separation_m: float = 0.0

    @property
    def is_good(self) -> bool:
        """Whether all landed, and none came too near."""
        return self.outcome == "landed" and (self.separation_m or 0.0) >= self.min_separation_m

    @property
    def memory_bytes_h(self) -> float:
        """Growth of memory by the hour, a straight line through the second half of the samples; NaN of too few."""
        return slope([s.t_s for s in self._late], [s.memory_bytes for s in self._late]) * 3600.0

    @property
    def log_bytes_s_drone(self) -> float:
        """What the log grows by in a second, for each drone; as above."""
        return slope([s.t_s for s in self._late], [s.log_bytes for s in self._late]) / self.drones

    @property
    def _late(self) -> tuple[Sample, ...]:
        return self.samples[len(self.samples) // 2 :]

    def to_json(self) -> str:
        """Indented JSON of every field and figure."""
        figures = {"memory_bytes_h": self.memory_bytes_h, "log_bytes_s_drone": self.log_bytes_s_drone}
        return json.dumps(asdict(self) | figures, indent=2, allow_nan=False)

    @property
    def text(self) -> str:
        """What a person reads of it."""
        last = self.samples[-1] if self.samples else None
        late = f", {last.late} of {last.cycles} control cycles late" if last and last.cycles else ""
        tick = f", a tick takes {self.tick.text} µs" if self.tick else ""
        near = "" if self.separation_m is None else f"never nearer than {self.separation_m:.2f} m, "
        return (
            f"{self.drones} drones at {self.speed:.2f} times real time, {self.outcome}: {near}"
            f"memory grows {self.memory_bytes_h * 1e-6:.1f} MB an hour, "
            f"the log {self.log_bytes_s_drone * 1e-3:.1f} kB a second and drone{late}{tick}"
        )


class Sampler:
    """Takes samples in the air; memory_bytes: what the process in question holds now."""

    def __init__(self, log: Path, hover_s: float, memory: Callable[[], int], progress: Progress) -> None:
        self.samples: list[Sample] = []
        self._state = ""
        self._log, self._hover_s, self._memory, self._progress = log, hover_s, memory, progress

    def receive_state(self, text: str) -> None:
        """The ground has published its state."""
        self._state = text

    def note(self, t_s: float, phase: str) -> None:
        """Some time later, in that phase."""
        if phase != Phase.HOLD.name or (self.samples and t_s < self.samples[-1].t_s + SAMPLED_S):
            return
        cycles = decode(self._state).cycles if self._state else Cycles()
        log_bytes = recorded(self._log).stat().st_size
        self.samples.append(Sample(t_s, self._memory(), log_bytes, cycles.count, cycles.late))
        self._progress(f"{(t_s - self.samples[0].t_s) / 60.0:.1f} of {self._hover_s / 60.0:g} minutes")


def soak(followers: int, hover_s: float, folder: Path, progress: Progress) -> Soak:
    """Hover for so many simulated seconds, the log in `folder` (OSError)."""
    scenario, log = hover(followers, hover_s), folder / "soak.mcap"
    sampler = Sampler(log, hover_s, memory_bytes, progress)
    flown = run_to_file(scenario, scenario.seed, log, sampler.note)
    return _result(scenario, sampler, log, flown.outcome.result, flown.realtime_factor)


async def soak_by_processes(
    followers: int, hover_s: float, folder: Path, progress: Progress, hosts: int | None, clock: Clock = REAL_TIME
) -> Soak:
    """The same in real time, as `gcs-sim fly` flies; everything it writes in `folder`. Raises as that does.

    hosts: so many processes share the drones; None: each is one.
    """
    files = Files(folder)
    with private_link("zenoh", ()) as link:
        scenario = hover(followers, hover_s)
        scenario = scenario.model_copy(update={"lab": scenario.lab.model_copy(update={"link": link})})
        async with running(scenario, scenario.seed, files, clock=clock, hosts=hosts) as flight:
            ground = flight.ground.process.pid
            sampler = Sampler(files.mcap, hover_s, lambda: memory_bytes(ground), progress)
            flight.bus.on_state(GCS_NAME, sampler.receive_state)
            outcome = await fly_on(flight, scenario, sampler.note, clock)
    return _result(scenario, sampler, files.mcap, outcome.result, clock.speed)


def _result(scenario: Scenario, sampler: Sampler, log: Path, outcome: str, speed: float) -> Soak:
    ticks_us, separation_m = of_log(log, speed)
    tick, lab = Timing.of(ticks_us) if ticks_us else None, scenario.lab
    samples = tuple(sampler.samples)
    return Soak(len(lab.vehicles), samples, outcome, speed, tick, separation_m, lab.limits.min_separation_m)


def of_log(file: Path, speed: float) -> tuple[list[float], float | None]:
    """Of the ground's log: its ticks in the air, microseconds of the machine; least separation, m."""
    phase, ticks_us, separation_m, sampled_ns = Phase.GROUND, list[float](), np.inf, 0
    for entry in read_log(file).only(MOCAP, PHASE, TIMING):
        if entry.topic is PHASE:
            phase = entry.message.phase
        elif phase not in AIRBORNE:
            continue
        elif entry.topic is TIMING:
            ticks_us.append(entry.message.latency_s / speed * 1e6)
        elif entry.t_ns >= sampled_ns + SEPARATION_NS:
            sampled_ns = entry.t_ns
            separation_m = min(separation_m, float(nearest(entry.message.pos_lab_m, entry.message.seen).min()))
    return ticks_us, separation_m if np.isfinite(separation_m) else None


def hover(followers: int, hover_s: float) -> Scenario:
    """The scenario: a take-off, and a landing that is asked for when the time is over."""
    scenario = of_size(followers)
    lab = scenario.lab
    kinds = {vehicle.profile: lab.profile_of(vehicle) for vehicle in lab.vehicles}
    lasting = tuple(
        kind.model_copy(update={"battery": kind.battery.model_copy(update={"capacity_mah": CAPACITY_MAH})})
        for kind in kinds.values()
    )
    # Nobody is to start: for more than a hundred the scenario's own path has no room, and a ground would refuse it.
    leader = lab.leader.model_copy(update={"trajectory": TrajectoryConfig()})
    lab = lab.model_copy(update={"profiles": lasting, "leader": leader})
    script = (
        Step(verb=Verb.ARM, phase="GROUND"),
        Step(verb=Verb.TAKEOFF, phase="ARMED"),
        Step(verb=Verb.LAND, phase="HOLD", after_s=hover_s),
    )
    return scenario.model_copy(update={"lab": lab, "longest_s": hover_s + LANDING_S, "script": script})


def memory_bytes(process: int | str = "self") -> int:
    """What a process holds in memory now."""
    return int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def slope(x: list[float], y: list[int]) -> float:
    """Of the straight line of least squares; NaN of fewer than two points."""
    if len(x) < 2:
        return float("nan")
    return float(np.polynomial.polynomial.polyfit(x, y, 1)[1])


def main(
    followers: Annotated[int, typer.Option(min=1, max=249, help="How many follow.")] = 9,
    minutes: Annotated[
        float, typer.Option(min=0.05, help="Of hover; ten drones take half as long in lockstep.")
    ] = 10.0,
    processes: Annotated[bool, typer.Option("--processes", help="In real time, by real processes.")] = False,
    hosts: Annotated[int | None, typer.Option(min=1, help="The same; so many of them share the drones.")] = None,
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, help="By processes: seconds of flight in one.")] = 1.0,
    as_json: Json = False,
) -> None:
    """Hover for long, and measure what grows; exit code 1 if it did not last and land, or two came too near."""
    console = Console(stderr=True, markup=False)
    with TemporaryDirectory() as folder, console.status("starting") as status:
        arguments = followers, 60.0 * minutes, Path(folder), status.update
        if processes or hosts is not None:
            result = asyncio.run(soak_by_processes(*arguments, hosts, Clock(speed)))
        else:
            result = soak(*arguments)
    print(result.to_json() if as_json else result.text)
    if not result.is_good:
        raise typer.Exit(FAILED)


if __name__ == "__main__":
    typer.run(main)
