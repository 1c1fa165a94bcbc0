"""What the parts of a flight cost on this machine: `python -m bench.timings`. It shows, and judges nothing.

The law, the estimate and the ground's tick are timed in a replay of a lockstep take-off, as they are called there; the
bus between processes as in flight: cameras that publish, the mocap process, and this process in the ground's place.
"""

import asyncio
import json
import math
from collections.abc import AsyncIterator, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import numpy as np
import typer
from rich.console import Console

from bench.call_counts import TickCalls, python_calls, tick_calls
from formation import topics
from formation.config import FollowerConfig, LabConfig
from formation.control import stack
from formation.control.law import Demand
from formation.control.limits.barriers import BarrierSettings, limit_demands
from formation.control.stack import ControlStack
from formation.estimation.update import initial
from formation.guidance.reference_generator import VehicleReference
from formation.maths import frames
from formation.maths.arrays import Float
from formation.maths.records import blank, rows
from formation.messages import LabFrame, RawFrame
from formation.model import Vec3Tuple
from formation.safety import rules
from gcs.core import GcsCore
from gcs.recording import INPUT_TOPICS
from sim import lockstep
from sim.cli.flights import compile_everything
from sim.ports import private_link
from sim.processes import ProcessGroup
from sim.scenario import Scenario, load
from sim.world import T0_NS
from wire import clock
from wire.config_file import dump
from wire.link_messages import DRONE_COMPONENT, GROUND, Address, AttitudeSetpoint, Ignore
from wire.mavlink.codec import Codec
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

FOLLOWERS = (2, 10, 20)
FOLLOWERS_MOST = 249
"""With the leader 250 drones: more have no MAVLink system id."""
LAST_ROW_M, ROW_M, ROW_MOST = 2.4, 0.6, 28
"""Behind the leader stand the twenty of the scenario as far as the first; further rows, so far apart, hold so many."""
FLIGHT_S = 5.0
"""Of each lockstep flight: up to the middle of its take-off."""
AIRBORNE_TICKS = 100
"""The last ones of it."""
MANY = 1000
"""Bodies of a large swarm, a metre from each other."""
CALLS, BATCHES = 200, 20
LAB, FRAMES = "triangle_line", 300
SHOWN_WITHIN_S = 60.0
Progress = Callable[[str], None]
"""Called with what is measured next."""


@dataclass(frozen=True, slots=True)
class Timing:
    """Shortest, median, 99th percentile and number of some durations; the shortest is what a busy machine leaves be."""

    least_us: float
    p50_us: float
    p99_us: float
    count: int

    @classmethod
    def of(cls, durations_us: Sequence[float]) -> "Timing":
        """Of durations in microseconds, one at least."""
        least, p50, p99 = np.percentile(durations_us, (0.0, 50.0, 99.0))
        return cls(float(least), float(p50), float(p99), len(durations_us))

    @property
    def text(self) -> str:
        """Median, and the shortest in brackets."""
        return f"{self.p50_us:.0f} ({self.least_us:.0f})"


@dataclass(frozen=True, slots=True)
class Swarm:
    """A tick with a frame, of a leader and so many followers, airborne; all durations of the whole swarm.

    step: `ControlStack.step`, which holds estimate and law; tick: `GcsCore.tick`, which holds the step.
    tick_calls: of our own Python functions in a tick, and of them to take in what arrived before it. lockstep_speed:
    simulated seconds a second, the drones included; python_calls: in one such second. No machine's load changes calls.
    """

    followers: int
    estimate: Timing
    law: Timing
    step: Timing
    tick: Timing
    tick_calls: TickCalls
    lockstep_speed: float
    python_calls: int

    @property
    def law_and_estimate_us_per_drone(self) -> float:
        """Both together, divided by the vehicles; medians."""
        return (self.estimate.p50_us + self.law.p50_us) / (self.followers + 1)


@dataclass(frozen=True, slots=True)
class Parts:
    """Single calls, microseconds: the kernels that look at pairs, of MANY bodies; the codec by attitude target."""

    nearest_us: float
    separation_filter_us: float
    encode_us: float
    decode_us: float


@dataclass(frozen=True, slots=True)
class Bus:
    """A frame on the lab's bus. hop: from the cameras' process to this one; path: the same by way of the mocap process.

    mocap_p50_us, mocap_p99_us: of the path what the mocap process takes, from having a frame to having it published,
    as it says itself; all else are two hops.
    """

    hop: Timing
    path: Timing
    mocap_p50_us: float
    mocap_p99_us: float


@dataclass(frozen=True, slots=True)
class Result:
    """Everything measured."""

    swarms: tuple[Swarm, ...]
    parts: Parts
    bus: Bus

    def to_json(self) -> str:
        """Indented JSON of every field and figure."""
        values = asdict(self)
        for value, swarm in zip(values["swarms"], self.swarms, strict=True):
            value["law_and_estimate_us_per_drone"] = swarm.law_and_estimate_us_per_drone
        return json.dumps(values, indent=2, allow_nan=False)


def bench(progress: Progress, followers: Sequence[int] = FOLLOWERS) -> Result:
    """Measure everything, of swarms with so many followers.

    Raises BusError, OSError and TimeoutError where the processes do not come to speak.
    """
    swarms = []
    for count in followers:
        progress(f"a flight of {count + 1} drones")
        swarms.append(swarm(count))
    progress("single calls")
    parts = Parts(nearest_us(), separation_filter_us(), *codec_us())
    progress("the bus between processes")
    return Result(tuple(swarms), parts, asyncio.run(bus()))


def swarm(followers: int) -> Swarm:
    """Fly into a take-off in lockstep, and time the ground's part of it in a replay."""
    scenario = of_size(followers)
    flown, entries = lockstep.run_in_memory(scenario, scenario.seed)
    core, ticks_us = GcsCore(scenario.lab, T0_NS), list[float]()
    with (
        timed(stack, "estimate") as estimates_us,
        timed(stack, "demand") as demands_us,
        timed(ControlStack, "step") as steps_us,
    ):
        for entry in entries:
            if entry.topic in INPUT_TOPICS:
                core.receive(entry.message, entry.t_ns)
            elif entry.topic is topics.TICK:
                steps, begun_ns = len(steps_us), clock.monotonic_ns()
                core.tick(entry.message.now_ns)
                if len(steps_us) > steps:
                    ticks_us.append((clock.monotonic_ns() - begun_ns) * 1e-3)
    return Swarm(
        followers, _airborne(estimates_us), _airborne(demands_us), _airborne(steps_us), _airborne(ticks_us),
        tick_calls(scenario.lab, entries, AIRBORNE_TICKS), flown.realtime_factor, python_calls(scenario),
    )  # fmt: skip


def _airborne(durations_us: Sequence[float]) -> Timing:
    return Timing.of(durations_us[-AIRBORNE_TICKS:])


def of_size(followers: int) -> Scenario:
    """The beginning of `twenty` with fewer followers, or with more, that stand in rows behind the others."""
    scenario = load("twenty")
    known = scenario.lab.followers
    more = (
        FollowerConfig(body=f"f{k + 1:02}", sysid=k + 2, offset_m=_position_m(k - len(known)))
        for k in range(len(known), followers)
    )
    lab = scenario.lab.model_copy(update={"followers": (*known[:followers], *more)})
    return scenario.model_copy(update={"lab": lab, "longest_s": FLIGHT_S})


def _position_m(k: int) -> Vec3Tuple:
    """Position k of the further rows: ROW_MOST in each, ROW_M from each other and from those in front."""
    row, column = divmod(k, ROW_MOST)
    return -LAST_ROW_M - ROW_M * (row + 1), ROW_M * (column - ROW_MOST // 2), 0.0


@contextmanager
def timed(owner: object, name: str) -> Iterator[list[float]]:
    """How long each call of the owner's function takes meanwhile, microseconds."""
    function, durations_us = getattr(owner, name), list[float]()

    def clocked(*arguments: object) -> object:
        begun_ns = clock.monotonic_ns()
        result = function(*arguments)
        durations_us.append((clock.monotonic_ns() - begun_ns) * 1e-3)
        return result

    setattr(owner, name, clocked)
    try:
        yield durations_us
    finally:
        setattr(owner, name, function)


def nearest_us() -> float:
    """Every body's distance to its nearest neighbour."""
    pos, known = in_a_square(MANY), np.ones(MANY, np.bool_)
    return call_us(lambda: rules.nearest(pos, known), 1)


def separation_filter_us() -> float:
    """The demands of all bodies at rest, none of which has to be altered."""
    n, pos = MANY, in_a_square(MANY)
    names, seen = tuple(str(k) for k in range(n)), np.ones(n, np.bool_)
    estimates = initial(LabFrame(0, 0, names, pos, np.tile(frames.IDENTITY, (n, 1)), seen), seen)
    settings = rows(BarrierSettings, [BarrierSettings(k, 0.05, 0.2, 3.0, 6.0, True, True, True) for k in range(n)])
    wanted, references = blank(Demand, n), blank(VehicleReference, n)
    wanted["motion"][:, 0, :3], references["airborne"] = pos, True
    return call_us(lambda: limit_demands(settings, wanted, estimates, references, 0), 1)


def codec_us() -> tuple[float, float]:
    """To encode an attitude target, and for its drone to decode it."""
    drone = Address(2, DRONE_COMPONENT)
    ground, aboard = Codec(GROUND), Codec(drone)
    message = AttitudeSetpoint(drone, 1000, frames.IDENTITY, np.zeros(3), 0.5, Ignore.NONE)
    data = ground.encode(message)
    return call_us(lambda: ground.encode(message)), call_us(lambda: aboard.receive(data))


def in_a_square(n: int) -> Float:
    """Positions (n, 3) at one height, a metre apart, row by row."""
    side = math.ceil(math.sqrt(n))
    return np.array([[k % side, k // side, 1.0] for k in range(n)])


def call_us(function: Callable[[], object], calls: int = CALLS) -> float:
    """Of one call, the median over some batches of `calls`, microseconds; the first call is not counted."""
    function()
    durations_us = []
    for _ in range(BATCHES):
        begun_ns = clock.monotonic_ns()
        for _ in range(calls):
            function()
        durations_us.append((clock.monotonic_ns() - begun_ns) * 1e-3 / calls)
    return float(np.median(durations_us))


async def bus() -> Bus:
    """Show frames in one process, align them in the mocap's, hear both here."""
    with private_link("zenoh", ()) as link, TemporaryDirectory() as folder:
        lab = load(LAB).lab.model_copy(update={"link": link})
        async with ProcessGroup(Path(folder)) as group, listening(lab) as delays:
            file = Path(folder) / "lab.toml"
            file.write_text(dump(lab), encoding="utf-8")
            await group.start("cameras", "bench.still_cameras", [str(file)])
            await group.start("mocap", "gcs", ["mocap", str(file)])
            watching = asyncio.create_task(group.watch())
            async with asyncio.timeout(SHOWN_WITHIN_S):
                while not watching.done() and not delays.enough:
                    await asyncio.sleep(0.05)
            if watching.done():
                watching.result()
            watching.cancel()
        inside = delays.inside_ms[-1]
        return Bus(
            Timing.of(delays.hops_us[-FRAMES:]), Timing.of(delays.paths_us[-FRAMES:]),
            1e3 * inside["p50"], 1e3 * inside["p99"],
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class MocapDelays:
    """Ages of raw frames and frames on arrival here, and the delays that the mocap process reports."""

    hops_us: list[float] = field(default_factory=list)
    paths_us: list[float] = field(default_factory=list)
    inside_ms: list[dict[str, float]] = field(default_factory=list)

    @property
    def enough(self) -> bool:
        """Whether there are enough frames for all figures."""
        return min(len(self.hops_us), len(self.paths_us)) >= FRAMES and bool(self.inside_ms)


@asynccontextmanager
async def listening(lab: LabConfig) -> AsyncIterator[MocapDelays]:
    """Measure the delays of frames on the lab's bus for as long as the block lasts."""
    session, delays = await ZenohBus.open(lab.link, lab.name), MocapDelays()
    mocap = MocapBus(session)

    def note(durations_us: list[float], frame: RawFrame | LabFrame) -> None:
        durations_us.append((clock.monotonic_ns() - frame.t_capture_ns) * 1e-3)

    mocap.on_raw(lambda frame: note(delays.hops_us, frame))
    mocap.on_frame(lambda frame: note(delays.paths_us, frame))
    mocap.on_state(lambda state: delays.inside_ms.append(state["inside_ms"]))
    try:
        yield delays
    finally:
        await session.close()


def main(
    followers: Annotated[
        list[int] | None,
        typer.Option(min=1, max=FOLLOWERS_MOST, help="How many follow; again for more swarms. 2, 10 and 20."),
    ] = None,
) -> None:
    """Time law, estimate, tick, codec, lockstep and bus on this machine, as JSON; some seconds. It judges nothing.

    A swarm of 101 drones takes two minutes.
    """
    compile_everything()
    with Console(stderr=True, markup=False).status("starting") as status:
        print(bench(status.update, followers or FOLLOWERS).to_json())


if __name__ == "__main__":
    typer.run(main)
