"""The lockstep host: a whole flight in one process, as fast as the machine goes, decided by scenario and seed alone."""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from analysis.load import Flight, from_records
from drone_agent.guard import core as guard
from drone_agent.simulation.attitude_loop import OWN, Physics
from formation.codes import FlightResult, Outcome
from formation.control.presets import Preset
from formation.topics import Topic
from gcs import warm_up as gcs_warm_up
from gcs.recording import Record, run_metadata
from mocap.core import MATRICES, QUATERNIONS, warm_up_source
from sim.monitors import WITHOUT_NONE, Without
from sim.scenario import Scenario, load
from sim.world import T0_NS, World
from wire import clock
from wire.logs.mcap_read import Entry
from wire.logs.mcap_write import LogWriter

Progress = Callable[[float, str], None]
"""Called with the simulated seconds and the phase, every tenth of a simulated second."""

ANY_SCENARIO = "triangle_line"
"""Flies all that is compiled."""
WARM_UP_NS = 300_000_000
PROGRESS_NS = 100_000_000
AFTER_NS = 500_000_000
"""What is still recorded after the flight has ended."""


@dataclass(frozen=True, slots=True)
class Flown:
    """A lockstep flight: how it ended, how long it was, and how much faster than time it ran."""

    outcome: Outcome
    duration_s: float
    realtime_factor: float


def run_to_file(
    scenario: Scenario,
    seed: int,
    path: Path,
    progress: Progress | None = None,
    physics: Physics = OWN,
    overwrite: bool = False,
) -> Flown:
    """Fly, recording to an MCAP file at `path` (OSError); overwrite: as of `LogWriter`."""
    with LogWriter(path, metadata(scenario, seed, "memory", T0_NS), threaded=False, overwrite=overwrite) as log:
        return fly(scenario, seed, log.write, progress, physics=physics)


def run_in_memory(
    scenario: Scenario, seed: int, without: Without = WITHOUT_NONE, gains: Preset | None = None, physics: Physics = OWN
) -> tuple[Flown, list[Entry]]:
    """Fly without a file; the records come back, as a reader of the log would give them."""
    records: list[Entry] = []

    def append(topic: Topic, message: object, t_ns: int) -> None:
        records.append(Entry(topic, t_ns, message))

    return fly(scenario, seed, append, without=without, gains=gains, physics=physics), records


def run_and_load(
    scenario: Scenario, seed: int, without: Without = WITHOUT_NONE, gains: Preset | None = None, physics: Physics = OWN
) -> tuple[Flown, Flight]:
    """Fly without a file; the flight comes back as it would be loaded from its log."""
    flown, records = run_in_memory(scenario, seed, without, gains, physics)
    return flown, from_records(metadata(scenario, seed, "memory", T0_NS), records)


def warm_up(scenario: Scenario) -> None:
    """Compile all that a flight of the scenario runs; processes started later find it in the cache on disk."""
    guard.warm_up()
    world = World(scenario, scenario.seed, lambda _topic, _message, _t_ns: None)
    while world.now_ns < T0_NS + WARM_UP_NS:
        world.step()
    gcs_warm_up.warm_up(scenario.lab)
    for source in (*QUATERNIONS, *MATRICES):  # which doctor and mocap process read later, whatever is flown now
        warm_up_source(source)


def warm_up_all() -> None:
    """Compile all that any flight runs."""
    warm_up(load(ANY_SCENARIO))


def warm_up_ground() -> None:
    """Compile what the ground runs in any flight: half of it all."""
    gcs_warm_up.warm_up(load(ANY_SCENARIO).lab)


def fly(
    scenario: Scenario,
    seed: int,
    record: Record,
    progress: Progress | None = None,
    without: Without = WITHOUT_NONE,
    gains: Preset | None = None,
    physics: Physics = OWN,
) -> Flown:
    """Fly until the operator is done, the flight fails or takes too long.

    without: monitors that are switched off; gains: those of the ground, in the place of the lab's preset; physics: what
    integrates the vehicles.
    """
    with uncollected():
        return _fly(World(scenario, seed, record, without, gains, physics), scenario.longest_s, progress)


def _fly(world: World, longest_s: float, progress: Progress | None) -> Flown:
    started_ns = clock.monotonic_ns()
    end_ns = T0_NS + round(longest_s * 1e9)
    reported_ns = T0_NS
    ended = False
    while world.now_ns < end_ns:
        world.step()
        if world.operator.outcome is not None and not ended:
            ended, end_ns = True, world.now_ns + AFTER_NS
        if progress is not None and world.now_ns >= reported_ns:
            reported_ns = world.now_ns + PROGRESS_NS
            progress((world.now_ns - T0_NS) * 1e-9, world.operator.phase.name)
    duration_s = (world.now_ns - T0_NS) * 1e-9
    elapsed_s = (clock.monotonic_ns() - started_ns) * 1e-9
    outcome = world.operator.outcome or Outcome(FlightResult.ABORTED, f"not over after {longest_s:g} s")
    return Flown(outcome, duration_s, duration_s / elapsed_s)


@contextmanager
def uncollected() -> Iterator[None]:
    """No garbage collection in between: a flight makes objects by the million, and no cycles of them to be found."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def metadata(scenario: Scenario, seed: int, link: str, t0_ns: int) -> dict[str, str]:
    """What a log says of its flight."""
    return run_metadata(scenario.lab, t0_ns) | {
        "scenario": scenario.name,
        "seed": str(seed),
        "link": link,
    }
