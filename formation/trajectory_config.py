"""What a commanded leader flies, as the lab file says it: the kinds of trajectories and the keys of each."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Annotated, Any, Literal, Protocol, Self

from pydantic import Field, ValidationInfo, model_validator

from formation.model import Model, Name, NoFlag, Number, Positive, Vec3Tuple, WrongKeyError

TrajectoryKind = Literal["hold", "line", "circle", "figure8", "lissajous", "waypoints", "polynomial", "file", "own"]
PathPoint = tuple[Number, Number, Number, Number, Number]
"""Time from the beginning, s; x, y, z in `lab`, m; heading about lab z, rad."""
POINTS_MOST, WAYPOINTS_MOST = 20_000, 500
STEP_LEAST_S = 1e-4
Cycles = Annotated[int, NoFlag, Field(ge=0, le=20)]


@dataclass(frozen=True, slots=True)
class Keys:
    """The keys of a kind of trajectory: those used, the one that sets its speed, and the one that sets its extent."""

    used: frozenset[str]
    speed_key: str
    extent: str


KINDS: Mapping[TrajectoryKind, Keys] = MappingProxyType(
    {
        "hold": Keys(frozenset({"duration_s"}), "yaw_rate_rad_s", "yaw_rate_rad_s"),
        "line": Keys(frozenset({"length_m", "duration_s", "laps"}), "duration_s", "length_m"),
        "circle": Keys(frozenset({"radius_m", "period_s", "duration_s", "laps"}), "period_s", "radius_m"),
        "figure8": Keys(frozenset({"length_m", "width_m", "period_s", "laps"}), "period_s", "length_m"),
        "lissajous": Keys(
            frozenset({"amplitude_m", "cycles", "phase_rad", "period_s", "laps"}), "period_s", "amplitude_m"
        ),
        "waypoints": Keys(frozenset({"waypoints_m", "speed_m_s", "laps"}), "speed_m_s", "waypoints_m"),
        "polynomial": Keys(frozenset({"waypoints_m", "speed_m_s", "laps"}), "speed_m_s", "waypoints_m"),
        "file": Keys(frozenset({"file", "points", "relative"}), "file", "file"),
        "own": Keys(frozenset({"name", "options", "points", "relative"}), "options", "options"),
    }
)
FROM_OUTSIDE = ("file", "own")


class PathReader(Protocol):
    """Who knows what is outside the lab file: files beside it, and what the lab's own packages make."""

    def points_of(self, kind: str, trajectory: Mapping[str, Any]) -> list[list[float]]:
        """The points of a trajectory of kind `file` or `own`; ValueError where there are none to be had."""


class TrajectoryConfig(Model):
    """What a commanded leader flies in the formation phase; how long it takes: `formation.guidance.trajectory`.

    laps: rounds of a circle, an eight or Lissajous's figure, a line's ways there and back, how often all waypoints are
    flown; not given: a circle as many rounds as fit duration_s, a line there only, everything else once. duration_s: of
    a hold, of a line's every way. width_m: of a figure of eight, half its length if not given. amplitude_m, cycles,
    phase_rad: of Lissajous's figure, along x, y, z. file: CSV of t, x, y, z, yaw, a Crazyswarm polynomial or a
    Skybrush show. name, options: of the lab's own, and what it is given. points: what either came to, as it is flown
    and logged; relative: moved so that they begin where the leader is.
    """

    kind: TrajectoryKind = "hold"
    """Kind of trajectory."""
    length_m: Positive = 1.0
    """Length of a line, or of a figure of eight along lab x."""
    width_m: Positive | None = None
    radius_m: Positive = 0.3
    """Radius of a circle."""
    amplitude_m: Vec3Tuple = (0.5, 0.5, 0.0)
    cycles: tuple[Cycles, Cycles, Cycles] = (3, 2, 1)
    phase_rad: Vec3Tuple = (0.0, 0.0, 0.0)
    period_s: Positive = 12.0
    """Time of one lap."""
    duration_s: Positive = 8.0
    speed_m_s: Positive = 0.5
    """Largest speed through waypoints."""
    yaw_rate_rad_s: Number = 0.0
    """Rate at which the leader turns as it flies."""
    waypoints_m: Annotated[tuple[Vec3Tuple, ...], Field(max_length=WAYPOINTS_MOST)] = ()
    """Points in `lab` to fly through."""
    laps: Annotated[int, NoFlag, Field(ge=1, le=1000)] | None = None
    file: str | None = None
    name: Name | None = None
    options: dict[str, float | int | str | bool] = Field(default_factory=dict)
    relative: bool = False
    points: Annotated[tuple[PathPoint, ...], Field(max_length=POINTS_MOST)] = ()

    @model_validator(mode="before")
    @classmethod
    def _read_outside(cls, values: Any, info: ValidationInfo) -> Any:
        """The points of what is outside the lab file, where they are not in it already."""
        if isinstance(values, dict) and values.get("kind") == "csv":
            raise WrongKeyError("kind", 'is gone: write "file", which reads a CSV, too', "csv")
        if not isinstance(values, dict) or values.get("kind") not in FROM_OUTSIDE or values.get("points"):
            return values
        reader: PathReader | None = info.context
        if reader is None:
            return values
        try:
            return values | {"points": reader.points_of(values["kind"], values)}
        except ValueError as error:
            raise WrongKeyError("name" if values["kind"] == "own" else "file", str(error)) from error

    @model_validator(mode="after")
    def _is_whole(self) -> Self:
        if self.kind in ("waypoints", "polynomial") and not self.waypoints_m:
            raise WrongKeyError("waypoints_m", f'is missing: kind "{self.kind}" needs `waypoints_m`, points of the lab')
        if self.kind == "file" and not (self.file or self.points):
            raise WrongKeyError("file", 'is missing: kind "file" flies the way in it')
        if self.kind == "own" and not (self.name or self.points):
            raise WrongKeyError("name", 'is missing: kind "own" flies what a package has registered under it')
        if self.kind in FROM_OUTSIDE:
            try:
                _check_times(self.points)
            except ValueError as error:
                where = f"{self.file}: " if self.file else ""
                raise WrongKeyError("file" if self.file else "points", f"{where}{error}") from error
        return self


def _check_times(points: tuple[PathPoint, ...]) -> None:
    """ValueError for a path that is none: fewer than two points, or times that do not rise from 0."""
    if len(points) < 2:
        raise ValueError(f"{len(points)} points: a way has two at least")
    if points[0][0] != 0.0:
        raise ValueError(f"the first point is at t = {points[0][0]:g} s: time is counted from it, so it is at 0")
    for k, (a, b) in enumerate(pairwise(points)):
        if not b[0] - a[0] >= STEP_LEAST_S:
            raise ValueError(
                f"point {k + 2} is at t = {b[0]:g} s, the one before it at {a[0]:g} s: times must rise, by "
                f"{STEP_LEAST_S:g} s or more"
            )
