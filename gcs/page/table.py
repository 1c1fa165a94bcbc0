"""The table of drones, for the page and for `gcs watch`: what each cell says, and how bad it is. Pure."""

from dataclasses import dataclass
from enum import IntEnum

from formation.safety.rules_table import (
    BATTERY_EMPTY,
    BATTERY_LOW,
    BEHIND_HOLD_S,
    BEHIND_WARN_S,
    LATE_SETPOINT_S,
    SILENT_S,
    STALE_SETPOINT_S,
)
from wire.ground_state import DroneState


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


def row(drone: DroneState, flying: bool) -> tuple[Cell, ...]:
    """One drone of the ground's state, a cell a column; flying: errors are shown for a swarm that is led somewhere."""
    mode = drone.mode + (" (pilot)" if drone.piloted else "")
    return (
        Cell(str(drone.sysid)),
        Cell(drone.body),
        Cell("APM" if drone.autopilot == "ArduPilot" else drone.autopilot or "-"),
        Cell(mode, Level.WARN if drone.piloted else Level.CALM),
        _armed(drone),
        Cell(_LANDED.get(drone.landed, "-")),
        Cell(_text(drone.battery_v, 1.0, 1)),
        _under(drone.battery, BATTERY_LOW, BATTERY_EMPTY, 100.0, 0),
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


def _text(value: float | None, times: float, digits: int, unknown: str = "-") -> str:
    return unknown if value is None else f"{value * times:.{digits}f}"


def _over(value: float | None, warn: float, bad: float, times: float, digits: int, unknown: str) -> Cell:
    """A value that is worse the larger it is; what never came is as bad as can be."""
    if value is None:
        return Cell(unknown, Level.BAD if unknown == "never" else Level.CALM)
    level = Level.BAD if value > bad else Level.WARN if value > warn else Level.CALM
    return Cell(_text(value, times, digits), level)


def _under(value: float | None, warn: float, bad: float, times: float, digits: int) -> Cell:
    """A value that is worse the smaller it is."""
    if value is None:
        return Cell("-")
    level = Level.BAD if value < bad else Level.WARN if value < warn else Level.CALM
    return Cell(_text(value, times, digits), level)
