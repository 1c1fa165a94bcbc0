"""`python -m bench.swarm`: many drones take off, hover and land, in lockstep or by real processes.

How near they came to each other is judged; what a tick of the ground takes is shown: in lockstep, of the CPU; by
processes, of the machine's time, from the receipt of a frame until the last drone's datagram was handed to Zenoh.
"""

import asyncio
import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from bench.command import FAILED, Json
from bench.soak import hover
from bench.timings import Timing, timed
from formation.messages import Phase
from formation.safety.rules import nearest
from formation.topics import COMMAND, MOCAP, PHASE, TIMING, Topic
from gcs.core import GcsCore
from sim.cli.flights import compile_everything
from sim.fly import Files, fly
from sim.lockstep import uncollected
from sim.ports import private_link
from sim.world import T0_NS, World
from wire.clock import Clock
from wire.logs.mcap_read import read_log

Progress = Callable[[str], None]
SAMPLED_NS = 100_000_000
FLYING = (Phase.TAKEOFF, Phase.HOLD, Phase.LAND)


@dataclass(frozen=True, slots=True)
class Swarm:
    """A hover of so many drones, and how it ended.

    separation_m: the least between two with motors on, sampled ten times a second; min_separation_m: what the lab's
    limits allow. tick: of the ground with a frame, in the air. Both None where nobody took off.
    speed: simulated seconds in one of CPU time; by processes, in one of the machine's.
    """

    drones: int
    outcome: str
    simulated_s: float
    separation_m: float | None
    min_separation_m: float
    tick: Timing | None
    speed: float

    @property
    def text(self) -> str:
        """What a person reads of it."""
        text = f"{self.drones} drones, {self.simulated_s:.0f} s at {self.speed:.2f} times real time, {self.outcome}"
        if self.separation_m is None or self.tick is None:
            return text
        return (
            f"{text}: never nearer than {self.separation_m:.2f} m (limit {self.min_separation_m:g}), the ground's tick "
            f"{self.tick.p50_us * 1e-3:.2f} ms (median), {self.tick.p99_us * 1e-3:.2f} ms (99 %)"
        )

    @property
    def is_good(self) -> bool:
        """Whether all landed, and none came too near."""
        if self.separation_m is None or self.outcome != "landed":
            return False
        return self.separation_m >= self.min_separation_m

    def to_json(self) -> str:
        """Indented JSON of every field."""
        return json.dumps(asdict(self), indent=2, allow_nan=False)


def swarm(followers: int, hover_s: float, progress: Progress) -> Swarm:
    """Fly it; no log is written."""
    scenario = hover(followers, hover_s)
    ticks_us, separation_m, begun_s = list[float](), np.inf, time.process_time()
    end_ns, sample_ns = T0_NS + round(scenario.longest_s * 1e9), T0_NS
    with uncollected(), timed(GcsCore, "tick", time.thread_time_ns) as all_ticks_us:

        def note(topic: Topic, _message: object, _t_ns: int) -> None:
            """A tick that was due to a frame writes down what it commands; there are others in between."""
            if topic is COMMAND and world.phase in FLYING:
                ticks_us.append(all_ticks_us[-1])

        world = World(scenario, scenario.seed, note)
        while world.now_ns < end_ns and world.operator.outcome is None:
            world.step()
            if world.now_ns >= sample_ns:
                sample_ns += SAMPLED_NS
                separation_m = min(separation_m, _separation_m(world))
                progress(f"{(world.now_ns - T0_NS) * 1e-9:.0f} s, {world.phase.name}")
    simulated_s, used_s = (world.now_ns - T0_NS) * 1e-9, time.process_time() - begun_s
    outcome = world.operator.outcome
    return Swarm(
        followers + 1,
        outcome.result if outcome else f"not over after {scenario.longest_s:g} s",
        simulated_s,
        separation_m if np.isfinite(separation_m) else None,
        scenario.lab.limits.min_separation_m,
        Timing.of(ticks_us) if ticks_us else None,
        simulated_s / used_s,
    )


def swarm_by_processes(
    followers: int, hover_s: float, hosts: int, folder: Path, progress: Progress, clock: Clock
) -> Swarm:
    """The same by real processes over Zenoh, `hosts` of which share the drones; all they write in `folder`.

    Raises as sim.fly does.
    """
    files = Files(folder)
    with private_link("zenoh", ()) as link:
        scenario = hover(followers, hover_s)
        scenario = scenario.model_copy(update={"lab": scenario.lab.model_copy(update={"link": link})})

        def note(t_s: float, state: str) -> None:
            progress(f"{t_s:.0f} s, {state}")

        outcome = asyncio.run(fly(scenario, scenario.seed, files, note, clock=clock, hosts=hosts))
    ended = outcome.result if outcome.result == "landed" else f"{outcome.result}: {outcome.reason}"
    ticks_us, separation_m, flown_s = of_log(files.mcap, clock.speed) if files.mcap.exists() else ([], None, 0.0)
    return Swarm(
        followers + 1, ended, flown_s, separation_m, scenario.lab.limits.min_separation_m,
        Timing.of(ticks_us) if ticks_us else None, clock.speed,
    )  # fmt: skip


def of_log(file: Path, speed: float) -> tuple[list[float], float | None, float]:
    """Of the ground's log: its ticks in the air, microseconds of the machine; least separation, m; length, s."""
    phase, ticks_us, separation_m = Phase.GROUND, list[float](), np.inf
    first_ns = t_ns = sampled_ns = 0
    for entry in read_log(file).only(MOCAP, PHASE, TIMING):
        t_ns = entry.t_ns
        first_ns = first_ns or t_ns
        if entry.topic is PHASE:
            phase = entry.message.phase
        elif entry.topic is TIMING and phase in FLYING:
            ticks_us.append(entry.message.latency_s / speed * 1e6)
        elif entry.topic is MOCAP and phase in FLYING and t_ns >= sampled_ns + SAMPLED_NS:
            sampled_ns = t_ns
            separation_m = min(separation_m, float(nearest(entry.message.pos_lab_m, entry.message.seen).min()))
    return ticks_us, separation_m if np.isfinite(separation_m) else None, (t_ns - first_ns) * 1e-9


def _separation_m(world: World) -> float:
    """The least distance of two drones with motors on."""
    samples = world.samples()
    pos, armed = np.array([s.pos_lab_m for s in samples]), np.array([s.armed for s in samples])
    return float(nearest(pos, armed).min())


def main(
    followers: Annotated[int, typer.Option(min=1, max=249, help="How many follow.")] = 99,
    seconds: Annotated[float, typer.Option(min=1.0, help="Of hover; a hundred drones take minutes.")] = 10.0,
    hosts: Annotated[
        int | None, typer.Option(min=1, help="By real processes, so many of which share the drones; else in lockstep.")
    ] = None,
    speed: Annotated[float, typer.Option(min=0.01, max=1.0, help="With --hosts: seconds of flight in one.")] = 1.0,
    as_json: Json = False,
) -> None:
    """Hover with many drones; exit code 1 if one did not land, or two came too near to each other."""
    compile_everything()
    console = Console(stderr=True, markup=False)
    with TemporaryDirectory() as folder, console.status("starting") as status:
        if hosts is None:
            result = swarm(followers, seconds, status.update)
        else:
            result = swarm_by_processes(followers, seconds, hosts, Path(folder), status.update, Clock(speed))
    print(result.to_json() if as_json else result.text)
    if not result.is_good:
        raise typer.Exit(FAILED)


if __name__ == "__main__":
    typer.run(main)
