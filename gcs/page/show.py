"""The view of the page and of `gcs watch`: the ground's state, the mocap's and the time make a `Show`. Pure."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from formation.messages import Phase, Verb
from formation.reasons import Reason
from formation.requests import CONFIGURED
from formation.safety.phases import AFTER_HOLD, AIRBORNE
from formation.safety.rules_table import (
    BEHIND_HOLD_S,
    BEHIND_WARN_S,
    LATE_SETPOINT_S,
    SILENT_S,
    STALE_SETPOINT_S,
)
from gcs.rehearsal import Rehearsal
from wire.ground_state import DroneState, GroundState
from wire.link_messages import LandedState
from wire.text import number_text

COLUMNS = (
    "id", "name", "make", "mode", "armed", "landed", "batt", "charge", "pose", "setpoint", "late", "heard", "loss",
    "error", "fence", "validator",
)  # fmt: skip
UNITS = ("", "", "", "", "", "", "V", "%", "ms", "ms", "ms", "s", "%", "mm", "m", "")
ABOUT = (
    "sysid", "body", "autopilot", "flight mode", "motors", "what it says of the floor", "battery, V", "battery left, %",
    "age of its pose, ms", "age of setpoints when they reach it, ms",
    "age of its telemetry when it is read: the backlog of its link, ms", "time since its heartbeat, s",
    "packets lost on its link, %", "distance from its slot or reference, mm", "distance to the fence, m",
    "why the pose validator rejects it",
)  # fmt: skip
POSE_WARN_S, POSE_BAD_S = 0.1, 0.2
BEAT_WARN_S = 2.0
LOSS_WARN, LOSS_BAD = 0.05, 0.2
ERROR_WARN_M, ERROR_BAD_M = 0.05, 0.2
FENCE_WARN_M = 0.1
_LANDED = {"ON_GROUND": "floor", "IN_AIR": "air", "TAKEOFF": "rising", "LANDING": "landing"}
LOST_S = 1.0
"""After so long without the ground's state, the page says so across everything."""
MOCAP_LOST_NS = 3_000_000_000
"""A state of the mocap process that is older is not shown: it publishes one a second."""
VERBS = (
    Verb.ARM,
    Verb.TAKE_CONTROL,
    Verb.TAKEOFF,
    Verb.START,
    Verb.RESUME,
    Verb.HOME,
    Verb.HOLD,
    Verb.LAND,
    Verb.RESET,
)
LABELS = {
    Verb.ARM: "Arm", Verb.TAKE_CONTROL: "Take control", Verb.TAKEOFF: "Take off", Verb.START: "Start",
    Verb.RESUME: "Resume", Verb.HOME: "Home", Verb.HOLD: "Hold", Verb.LAND: "Land", Verb.RESET: "Reset",
    Verb.ACKNOWLEDGE: "Acknowledge", Verb.SHAPE: "Shape", Verb.TRAJECTORY: "Choose",
}  # fmt: skip


class Level(IntEnum):
    """How much a value wants to be looked at."""

    CALM = 0
    WARN = 1
    BAD = 2


@dataclass(frozen=True, slots=True)
class Cell:
    """One value as it is shown."""

    text: str
    level: Level = Level.CALM


def row(drone: DroneState, flying: bool, battery_levels: tuple[float, float]) -> tuple[Cell, ...]:
    """One drone of the ground's state, a cell a column; flying: errors are shown for a swarm that is led somewhere."""
    mode = "left out" if drone.excluded else drone.mode + (" (pilot)" if drone.piloted else "")
    return (
        Cell(str(drone.sysid)),
        Cell(drone.body),
        Cell("APM" if drone.autopilot == "ArduPilot" else drone.autopilot or "-"),
        Cell(mode, Level.WARN if drone.piloted else Level.CALM),
        _armed(drone),
        Cell(_LANDED.get(drone.landed, "-")),
        Cell(number_text(drone.battery_v, 1.0, 1)),
        _under(drone.battery, *battery_levels, 100.0, 0),
        _over(drone.age_s, POSE_WARN_S, POSE_BAD_S, 1e3, 0, "never"),
        _over(drone.setpoint_age_s, LATE_SETPOINT_S, STALE_SETPOINT_S, 1e3, 0, "-"),
        _over(drone.link_behind_s, BEHIND_WARN_S, BEHIND_HOLD_S, 1e3, 0, "-"),
        _over(drone.heartbeat_age_s, BEAT_WARN_S, SILENT_S, 1.0, 1, "never"),
        _over(drone.loss, LOSS_WARN, LOSS_BAD, 100.0, 1, "-"),
        _over(drone.error_m, ERROR_WARN_M, ERROR_BAD_M, 1e3, 0, "-") if flying else Cell("-"),
        _under(drone.fence_margin_m, FENCE_WARN_M, 0.0, 1.0, 2),
        Cell("ok") if drone.rejected is None else Cell(drone.rejected, Level.BAD),
    )


def worst(cells: tuple[Cell, ...]) -> Level:
    """The worst of a row."""
    return max(cell.level for cell in cells)


def _armed(drone: DroneState) -> Cell:
    if drone.stopped_ms is not None:
        return Cell("CUT", Level.BAD)
    return Cell("ARMED" if drone.armed else "off")


def _over(value: float | None, warn: float, bad: float, times: float, digits: int, unknown: str) -> Cell:
    """A value that is worse the larger it is; what never came is as bad as can be."""
    if value is None:
        return Cell(unknown, Level.BAD if unknown == "never" else Level.CALM)
    level = Level.BAD if value > bad else Level.WARN if value > warn else Level.CALM
    return Cell(number_text(value, times, digits), level)


def _under(value: float | None, warn: float, bad: float, times: float, digits: int) -> Cell:
    """A value that is worse the smaller it is."""
    if value is None:
        return Cell("-")
    level = Level.BAD if value < bad else Level.WARN if value < warn else Level.CALM
    return Cell(number_text(value, times, digits), level)


@dataclass(frozen=True, slots=True)
class Step:
    """Something an operator can ask for, and every reason against it.

    flying: whether any drone may be. out_of_turn: it is for other phases.
    """

    verb: Verb
    reasons: tuple[str, ...]
    flying: bool = True
    out_of_turn: bool = False

    @property
    def allowed(self) -> bool:
        """Whether nothing is known against it."""
        return not self.reasons

    @property
    def is_idle(self) -> bool:
        """Whether nobody misses it now: it is for another phase, or for drones that fly."""
        return self.out_of_turn or (self.verb in (Verb.TAKE_CONTROL, Verb.LAND) and not self.flying)


@dataclass(frozen=True, slots=True)
class Show:
    """Everything but the room and the alarms, in words. lost: in what the connection to the ground is lost, or empty.

    vital: short facts of the machines, each with a name and a value; countdowns: likewise, with seconds left.
    not_landed: drones whose motors may still turn, though the landing or the stop is over. left_out: in words, empty
    for none.
    """

    lost: str
    phase: Phase | None
    cause: str
    since: str
    steps: tuple[Step, ...]
    rows: tuple[tuple[Cell, ...], ...]
    countdowns: tuple[str, ...]
    stop: str
    not_landed: tuple[str, ...]
    vital: tuple[tuple[str, Cell], ...]
    left_out: str = ""


NOTHING_YET = Show("waiting to hear the ground: `gcs run` starts one", None, "", "", (), (), (), "", (), ())


@contextmanager
def none_of_ours(whose: str) -> Iterator[None]:
    """While inside, what a state that is none of this version's raises is ValueError, and says whose state it was."""
    try:
        yield
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise ValueError(f"no state of a {whose} of this version: {type(error).__name__}: {error}") from error


def show(state: GroundState | None, mocap: Mapping[str, Any] | None, silent_s: float) -> Show:
    """The view of the newest states; silent_s: since the ground was last heard, s."""
    if state is None:
        return NOTHING_YET
    flying = state.phase in AIRBORNE
    return Show(
        lost=f"nothing heard of the ground for {silent_s:.0f} s" if silent_s > LOST_S else "",
        phase=state.phase,
        cause=cause(state),
        since=_clock(state.phase_s),
        steps=tuple(_step(verb, state) for verb in VERBS),
        rows=tuple(row(drone, flying, state.battery_levels) for drone in state.drones),
        countdowns=countdowns(state),
        stop=stop_text(state),
        not_landed=state.not_landed,
        vital=vital(state, mocap),
        left_out=state.left_out,
    )


def cause(state: GroundState) -> str:
    """Why the phase is what it is, and what leads on from HOLD."""
    return f"{state.cause}; {AFTER_HOLD}" if state.phase is Phase.HOLD else state.cause


def _step(verb: Verb, state: GroundState) -> Step:
    flying = any(drone.armed or drone.landed == LandedState.IN_AIR.name for drone in state.drones)
    out_of_turn = Reason.OUT_OF_TURN.code in state.reject_codes.get(verb, ())
    return Step(verb, state.allowed.get(verb, ()), flying, out_of_turn)


def countdowns(state: GroundState) -> tuple[str, ...]:
    """The countdowns: armed drones that disarm by themselves (the first of them), a landing's time, a trajectory's."""
    texts = []
    left = [(drone.disarms_in_s, drone.body) for drone in state.drones if drone.disarms_in_s is not None]
    if left:
        texts.append(f"{min(left)[1]} disarms itself in {min(left)[0]:.1f} s")
    if state.landing_left_s is not None:
        texts.append(f"landing: {state.landing_left_s:.0f} s at most")
    progress, name = state.trajectory_s, state.trajectory
    if progress is not None and state.trajectory_started and not state.trajectory_done:
        called = "" if name == CONFIGURED else f" {name}"
        texts.append(f"leader's trajectory{called}: {progress[1] - progress[0]:.0f} s of {progress[1]:.0f} s left")
    return tuple(texts)


def stop_text(state: GroundState) -> str:
    """The effect of a stop so far: which drones report their motors off, after how many ms, and which do not."""
    if state.phase is not Phase.STOPPED:
        return ""
    done = [(drone.body, drone.stopped_ms) for drone in state.drones if drone.stopped_ms is not None]
    open_ = [drone.body for drone in state.drones if drone.stopped_ms is None]
    text = f"{len(done)} of {len(state.drones)} drones report their motors off"
    if done:
        text += ": " + ", ".join(f"{name} {ms:.0f} ms" for name, ms in done)
    return text + (f"; NOT YET: {', '.join(open_)}" if open_ else "")


def not_landed_text(bodies: Sequence[str]) -> str:
    """Which drones are not known to have landed, though the landing or the stop is over; empty for none."""
    return f"NOT KNOWN TO HAVE LANDED: {', '.join(bodies)}" if bodies else ""


def vital(state: GroundState, mocap: Mapping[str, Any] | None) -> tuple[tuple[str, Cell], ...]:
    """Mocap, control cycles, log and disk."""
    cycles, log = state.cycles, state.log
    timing = None if mocap is None else mocap.get("timing")
    texts: list[tuple[str, Cell]] = []
    if timing is None:
        ages_s = [drone.age_s for drone in state.drones if drone.age_s is not None]
        if ages_s and min(ages_s) <= POSE_BAD_S:  # its state comes once a second, frames go on meanwhile
            texts.append(("mocap", Cell(f"pose {min(ages_s) * 1e3:.0f} ms old")))
        else:
            texts.append(("mocap", Cell("not heard", Level.WARN)))
    else:
        lost = float(timing["lost_share"])
        texts += [
            ("mocap", Cell(f"{timing['rate_hz']:.0f} Hz")),
            ("jitter", Cell(f"{timing['jitter_s'] * 1e3:.1f} ms")),
            (
                "longest gap",
                Cell(f"{timing['gap_s'] * 1e3:.0f} ms", Level.WARN if timing["gap_s"] > 0.1 else Level.CALM),
            ),
            ("frames lost", Cell(f"{lost:.1%}", Level.WARN if lost > 0.05 else Level.CALM)),
        ]
    late = f"{cycles.late} of {cycles.count}, worst {cycles.worst_ms:.0f} ms"
    share = state.counters.late_share
    texts.append(("late cycles", Cell(late)))
    texts.append(("frames missed", Cell(f"{share:.0%}", Level.BAD if share > 0.2 else Level.CALM)))
    text = f"{log.name}, " + ("-" if log.bytes is None else f"{log.bytes / 1e6:.1f} MB")
    texts.append(("log", Cell(state.log_trouble or text, Level.BAD if state.log_trouble else Level.CALM)))
    if (free := log.free_bytes) is not None:
        texts.append(("disk left", Cell(f"{free / 1e9:.1f} GB", Level.WARN if free < 1e9 else Level.CALM)))
    return tuple(texts)


def rehearsed(rehearsal: Rehearsal | None, lab: str) -> Cell:
    """How the lab of that name (gcs.rehearsal) was rehearsed last."""
    if rehearsal is None:
        return Cell("none: gcs rehearse")
    if rehearsal.lab != lab:
        return Cell(f"{rehearsal.date}, of another lab file: gcs rehearse", Level.WARN)
    if not rehearsal.passed:
        return Cell(f"{rehearsal.date}, not passed: {rehearsal.folder}", Level.BAD)
    return Cell(f"{rehearsal.date}, passed")


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 60}:{int(seconds) % 60:02d}"
