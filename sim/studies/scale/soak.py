"""`gcs-sim benchmark soak`: one long hover in lockstep, its log written: what memory and log grow by meanwhile.

Everything runs in this one process, so that what grows is an upper bound for the ground alone.
"""

import json
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from formation.messages import Phase, Verb
from sim.lockstep import run_to_file
from sim.scenario import Scenario
from sim.script import Step
from sim.studies.bench import of_size

SAMPLED_S = 5.0
CAPACITY_MAH = 1e6
"""Of each battery: the flight ends for no low one."""
Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class Sample:
    """The state of the process at a simulated time."""

    t_s: float
    memory_bytes: int
    log_bytes: int


@dataclass(frozen=True, slots=True)
class Soak:
    """A hover of so many drones; samples: in the air, SAMPLED_S apart; phase: at the end.

    speed: simulated seconds a second.
    """

    drones: int
    samples: tuple[Sample, ...]
    phase: str
    speed: float

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


def soak(followers: int, minutes: float, folder: Path, progress: Progress) -> Soak:
    """Hover for so many simulated minutes, the log in `folder` (OSError)."""
    scenario, log = hover(followers, 60.0 * minutes), folder / "soak.mcap"
    samples: list[Sample] = []
    last_phase = Phase.GROUND.name

    def note(t_s: float, phase: str) -> None:
        nonlocal last_phase
        last_phase = phase
        if phase == Phase.HOLD.name and (not samples or t_s >= samples[-1].t_s + SAMPLED_S):
            samples.append(Sample(t_s, memory_bytes(), log.stat().st_size))
            progress(f"{t_s / 60.0:.1f} of {minutes:g} minutes")

    flown = run_to_file(scenario, scenario.seed, log, note)
    return Soak(followers + 1, tuple(samples), last_phase, flown.realtime_factor)


def hover(followers: int, longest_s: float) -> Scenario:
    """The scenario: a take-off, and a landing that is asked for when the time is over."""
    scenario = of_size(followers)
    lab = scenario.lab
    kinds = {vehicle.profile: lab.profile_of(vehicle) for vehicle in lab.vehicles}
    lasting = tuple(
        kind.model_copy(update={"battery": kind.battery.model_copy(update={"capacity_mah": CAPACITY_MAH})})
        for kind in kinds.values()
    )
    lab = lab.model_copy(update={"profiles": lasting})
    script = (
        Step(verb=Verb.ARM, phase="GROUND"),
        Step(verb=Verb.TAKEOFF, phase="ARMED"),
        Step(verb=Verb.LAND, phase="HOLD", after_s=longest_s),
    )
    return scenario.model_copy(update={"lab": lab, "longest_s": longest_s, "script": script})


def memory_bytes() -> int:
    """What this process holds in memory now."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def slope(x: list[float], y: list[int]) -> float:
    """Of the straight line of least squares; NaN of fewer than two points."""
    if len(x) < 2:
        return float("nan")
    return float(np.polynomial.polynomial.polyfit(x, y, 1)[1])
