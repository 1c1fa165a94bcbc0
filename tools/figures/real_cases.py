"""Faults of real processes, one flight each: what is done to whom, and what is true of the drones then."""

import os
import resource
import shutil
import signal
import subprocess
from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

import numpy as np

from drone_agent.autopilots import MODELS
from drone_agent.autopilots.parameters import Parameters
from formation.messages import Phase, PhaseChange, Verb
from formation.topics import PHASE
from sim.campaign import oracle
from sim.campaign.recorder import PLANNED
from sim.faults.fault import Family, Fault
from sim.script import FLIGHT
from tools.figures.real_flight import DOWN_S, LINKS, START_S, SYSIDS, Hung, LinkKind, Room
from wire.logs.mcap_read import read_log
from wire.process.daemon import LATE_NS

WITHIN_S = 5.0
ALARM_S = 1.0
FLIES_S = 10.0
"""From arming to well into the formation."""
FILE_SYSTEM_MIB = 16
"""Room for the log until `fill` leaves none: a flight records some 40 kB a second."""
POOR_LINK = (
    Fault(family=Family.DROP, severity=0.2), Fault(family=Family.JITTER, severity=0.02),
    Fault(family=Family.REORDER, severity=0.1), Fault(family=Family.DUPLICATE, severity=0.1),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Run:
    """One flight. seconds: from the fault until the last drone's motors were off. reasons: why it was not contained."""

    what: str
    phase: str
    seconds: float
    height_m: float
    drift_m: float
    impact_m_s: float
    reasons: tuple[str, ...] = ()
    extra: dict[str, float] = field(default_factory=dict)


Fly = Callable[[Room, np.random.Generator], Awaitable[Run]]


@dataclass(frozen=True, slots=True)
class Case:
    """A kind of fault: how it is flown, how often unless told otherwise, over which links."""

    fly: Fly
    count: int = 10
    links: tuple[LinkKind, ...] = LINKS
    bridged: bool = False
    relayed: bool = False
    logs_apart: bool = False
    rate_hz: float = 50.0
    circle_s: float = 60.0


def disarm_delay_s() -> float:
    """What PX4 itself waits for, landed, before it disarms."""
    model = MODELS["px4"]
    return model.timing(Parameters(model.table, dict(model.table.indoor))).disarm_landing_s


def judged(
    room: Room, what: str, phase: str, onset_ns: int, *, down: bool, within_s: float = np.inf,
    sysids: Sequence[int] = SYSIDS, extra: dict[str, float] | None = None, reasons: Sequence[str] = (),
) -> Run:  # fmt: skip
    """What the truth says of the flight; down: whether all came down in time; reasons: what else was wrong."""
    verdict, truth = room.truths.verdict(room.scenario, onset_ns, sysids)
    found = [f"{v.kind}: {v.text}" for v in verdict.violations]
    after = truth.t_s >= truth.t_onset_s
    armed = truth.t_s[after & truth.armed.any(axis=1)]
    seconds = float(armed[-1] - truth.t_onset_s) if len(armed) else 0.0
    if not down and not found:
        found.append("not down in time")
    if seconds > within_s:
        found.append(f"motors off after {seconds:.1f} s, {within_s:g} are allowed")
    height_m = float(truth.pos_m[after][0, :, 2].max()) if after.any() else 0.0
    return Run(what, phase, seconds, height_m, verdict.drift_m, _impact_m_s(truth), (*found, *reasons), extra or {})


def _impact_m_s(truth: oracle.Truth) -> float:
    """The fastest touch-down."""
    worst = 0.0
    for i in range(len(truth.names)):
        low = truth.pos_m[:, i, 2] < oracle.ON_FLOOR_M
        for k in (np.flatnonzero(low[1:] & ~low[:-1]) + 1).tolist():
            worst = max(worst, float(np.linalg.norm(truth.vel_m_s[max(k - 3, 0) : k + 1, i], axis=-1).max()))
    return worst


async def ground_killed(room: Room, rng: np.random.Generator) -> Run:
    """SIGKILL at any moment from arming on: every drone lands and disarms by itself."""
    after_s = float(rng.uniform(0.0, FLIES_S))
    async with room.take_off():
        if not await room.until(room.truths.armed, START_S):
            raise Hung(f"never armed: {room.whereabouts()}")
        await room.sleep(after_s)
        phase, onset_ns = room.operator.phase.name, room.kill("gcs")
    down = await room.until(lambda: room.truths.down(onset_ns), DOWN_S)
    what = f"gcs killed {after_s:.2f} s after arming"
    return judged(room, what, phase, onset_ns, down=down, within_s=WITHIN_S + disarm_delay_s())


def killed(name: str) -> Fly:
    """SIGKILL in the formation, and back after a while; then the operator has all land."""
    return _disturbed(name, signal.SIGKILL, 0.2, 3.0)


def stopped(name: str) -> Fly:
    """SIGSTOP for 20 ms to 5 s in the formation; then the operator has all land."""
    return _disturbed(name, signal.SIGSTOP, 0.02, 5.0)


def _disturbed(name: str, number: signal.Signals, low_s: float, high_s: float) -> Fly:
    async def fly(room: Room, rng: np.random.Generator) -> Run:
        after_s = float(rng.uniform(0.3, 3.0))
        for_s = float(np.exp(rng.uniform(np.log(low_s), np.log(high_s))))
        # A simulated drone is its agent: who kills it, or stops it for longer than it can be late, takes it away.
        gone = name.startswith("agent") and (number is signal.SIGKILL or for_s > 0.5 * LATE_NS * 1e-9)
        left = [sysid for sysid in SYSIDS if not (gone and name == f"agent-{sysid}")]
        async with room.take_off():
            await room.until_phase(Phase.FORMATION)
            await room.sleep(after_s)
            room.spared = name if gone else ""
            onset_ns = room.kill(name, number)
            try:
                await room.sleep(for_s)
            finally:
                if number is signal.SIGSTOP:
                    room.kill(name, signal.SIGCONT)
            if number is signal.SIGKILL:
                await room.flight.group.child(name).process.wait()
                await room.flight.group.again(name)
            await room.sleep(2.0)
        down = await room.bring_down(onset_ns, left)
        verb = "killed" if number is signal.SIGKILL else "stopped"
        return judged(room, f"{name} {verb} for {for_s:.2f} s", "FORMATION", onset_ns, down=down, sysids=left)

    return fly


async def log_full(room: Room, rng: np.random.Generator) -> Run:
    """The file system under the log is full in flight: an alarm, no other command; then nobody arms."""
    log = room.files.mcap
    async with room.take_off():
        await room.until_phase(Phase.FORMATION)
        await room.sleep(float(rng.uniform(0.5, 2.0)))
        said = _drones_said(room)
        how, onset_ns = fill(log, room.flight.group.child("gcs").process.pid), room.clock.monotonic_ns()
        alarmed = await room.until(lambda: bool(room.state["log_trouble"]), 10.0)
        alarm_s = (room.clock.monotonic_ns() - onset_ns) * 1e-9
        await room.sleep(3.0)
        reasons = [] if alarmed and alarm_s <= ALARM_S else [f"alarm after {alarm_s:.2f} s"]
        if room.operator.phase is not Phase.FORMATION or _drones_said(room) != said:
            reasons.append(f"the flight changed: {room.operator.phase.name}, {_drones_said(room)[len(said) :]!r}")
    down = await room.bring_down(onset_ns, SYSIDS)
    await room.until(lambda: room.state["phase"] == "GROUND", 5.0)
    reply = await room.ask(Verb.ARM)
    if reply.accepted or "recorded" not in reply.text:
        reasons.append(f"armed all the same: {reply.text!r}")
    return judged(room, how, "FORMATION", onset_ns, down=down, extra={"alarm_s": alarm_s}, reasons=reasons)


def _drones_said(room: Room) -> str:
    return "".join(room.said(f"agent-{sysid}") for sysid in SYSIDS)


@contextmanager
def small_file_system(folder: Path) -> Iterator[None]:
    """A few MiB of its own there, where this user may mount one; else `fill` limits the file's size instead."""
    folder.mkdir(parents=True, exist_ok=True)
    mounted = False
    if mount := shutil.which("mount"):
        words = [mount, "-t", "tmpfs", "-o", f"size={FILE_SYSTEM_MIB}m", "tmpfs", str(folder)]
        mounted = subprocess.run(words, check=False, capture_output=True).returncode == 0
    try:
        yield
    finally:
        if mounted:
            subprocess.run(["umount", "--lazy", str(folder)], check=True)


def fill(log: Path, writer: int) -> str:
    """Leave no room for the log, which the process `writer` keeps; what was done.

    ENOSPC on a small file system of its own, EFBIG elsewhere.
    """
    if os.path.ismount(log.parent):
        with (log.parent / "filler").open("wb", buffering=0) as file:
            try:
                while True:
                    file.write(bytes(4096))
            except OSError:
                return "file system full (ENOSPC)"
    limit = log.stat().st_size
    resource.prlimit(writer, resource.RLIMIT_FSIZE, (limit, limit))
    return "file limited to its size (EFBIG)"


async def poor_link(room: Room, _rng: np.random.Generator) -> Run:
    """A whole flight over a link that loses a fifth, delays by 20 ms, reorders and repeats a tenth: as planned."""
    assert room.relay is not None
    room.relay.meet(POOR_LINK, POOR_LINK)
    async with room.take_off(FLIGHT) as walk:
        onset_ns = room.clock.monotonic_ns()
        flown = await room.until(walk.done, 120.0)
        reasons = [] if flown and str(room.operator.outcome).startswith("Outcome(result='landed'") else [
            f"not landed as planned: {room.operator.outcome}, in {room.operator.phase.name}"
        ]  # fmt: skip
    down = await room.until(lambda: room.truths.down(onset_ns), DOWN_S)
    changes = [e.message for e in read_log(room.files.mcap).entries if e.topic is PHASE]
    causes = [change.cause for change in changes if isinstance(change, PhaseChange)]
    reasons += [f"nuisance: {cause}" for cause in causes if not cause.startswith(PLANNED)]
    holds = _drones_said(room).count("Setpoints are stale")
    return judged(
        room, "20 % loss, 20 ms jitter", "whole", onset_ns, down=down, extra={"holds": holds}, reasons=reasons
    )


CASES: Mapping[str, Case] = MappingProxyType(
    {
        "ground-killed": Case(ground_killed, 200),
        "mocap-killed": Case(killed("mocap")),
        "agent-killed": Case(killed("agent-2")),
        "bridge-killed": Case(killed("bridge-2"), bridged=True),
        "ground-stopped": Case(stopped("gcs")),
        "mocap-stopped": Case(stopped("mocap")),
        "agent-stopped": Case(stopped("agent-2")),
        "bridge-stopped": Case(stopped("bridge-2"), bridged=True),
        "log-full": Case(log_full, 3, logs_apart=True),
        "poor-link": Case(poor_link, 3, ("udp",), relayed=True, rate_hz=100.0, circle_s=6.0),
    }
)
"""By name."""
