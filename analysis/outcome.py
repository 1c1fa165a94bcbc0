"""How a flight ended, from its record alone: `landed`, `held`, or `cut`, `lost`, `aborted` with the reason.

A landing is more than a phase: every drone came down no faster than a landing does, inside the fence, near where it
was led, and reported itself that its motors are off. A drone that fell or fell silent makes the flight `lost`; motors
that were cut in the air make it `cut`; a flight that ended otherwise than the operator asked is `aborted`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from analysis.links import from_drones, from_ground
from analysis.load import Flight, PhaseSpan, Vehicle
from analysis.reading import IMPORTED
from analysis.tracking import reference_lab_m
from formation.codes import FlightResult, Outcome
from formation.maths.arrays import Float
from formation.messages import Phase, Verb
from formation.safety.phases import AIRBORNE
from wire.link_messages import DISARM_IN_FLIGHT, CommandLong, Heartbeat, MavCommand, MessageId

FALL_OVER_M_S = 1.5  # faster than the configured descent by more than this is a fall: from 0.2 m up it is
NEAR_FLOOR_M = 0.05  # height of the markers above where they stood: under this the drone has touched down
TOUCH_WINDOW_S = 0.1
IN_AIR_M = 0.15
LED_UP = (Phase.TAKEOFF, Phase.FORMATION, Phase.HOLD)
POSITION_ERROR_M = 1.0  # horizontally from where it was led
UNHEARD_S = 3.0
CONFIRM_S = 1.5  # heartbeats come once a second: the ground's state at the landing's end shows by then
HEARTBEATS = frozenset({MessageId.HEARTBEAT})
COMMANDS = frozenset({MessageId.COMMAND_LONG})


@dataclass(frozen=True, slots=True, eq=False)
class Path:
    """Where the mocap saw one drone, while it saw it: t_s (T,), pos_lab_m (T, 3), height_m (T,) above its start."""

    t_s: Float
    pos_lab_m: Float
    height_m: Float

    def height_at(self, t_s: float) -> float:
        """The newest height by then, m; NaN before the first."""
        k = int(np.searchsorted(self.t_s, t_s, "right")) - 1
        return float(self.height_m[k]) if k >= 0 else float("nan")


def outcome(flight: Flight) -> Outcome:
    """How it ended; of several failures the worst, and its first reason."""
    if not flight.phases and IMPORTED in flight.run.metadata:
        return Outcome(FlightResult.IMPORTED)
    if not flight.phases:
        return Outcome(FlightResult.ABORTED, "the log holds no phases")
    drones = [(i, v) for i, v in enumerate(flight.vehicles) if v.column is not None]
    paths = {v.body: _path(flight, i) for i, v in drones} if flight.spans(*AIRBORNE) else {}
    if not flight.spans(*LED_UP) and not any((path.height_m > IN_AIR_M).any() for path in paths.values()):
        stopped = flight.spans(Phase.STOPPED)
        return Outcome(FlightResult.ABORTED, stopped[0].cause or "emergency stop" if stopped else "never took off")
    beats = _last_heartbeats(flight)
    for result, reasons in (
        (FlightResult.CUT, _cuts(flight, paths)),
        (FlightResult.LOST, (text for _, v in drones for text in _losses(flight, v, paths[v.body], beats))),
        (FlightResult.ABORTED, _aborts(flight, drones, beats)),
    ):
        reason = next(iter(reasons), None)
        if reason is not None:
            return Outcome(result, reason)
    return Outcome(FlightResult.HELD if flight.phases[-1].phase is Phase.HOLD else FlightResult.LANDED)


def _aborts(
    flight: Flight, drones: list[tuple[int, Vehicle]], beats: dict[int, tuple[float, bool]] | None
) -> Iterator[str]:
    last = flight.phases[-1]
    landings = _landings(flight)
    for landing in landings:
        if not _asked_for(flight, landing.start_s):
            yield landing.cause or "landed unasked"
    if last.phase in AIRBORNE and not flight.closed:
        yield f"the log ends in {last.phase.name}, and its ground did not end it: drones may be in the air"
    if last.phase not in (Phase.HOLD, Phase.GROUND, Phase.ARMED):
        yield f"the log ends in {last.phase.name}"
    if landings and last.phase is not Phase.HOLD and beats is not None:
        yield from (
            f"{v.body} is still armed after the landing" for _, v in drones if beats.get(v.sysid or 0, (0.0, False))[1]
        )


def _landings(flight: Flight) -> list[PhaseSpan]:
    """Every landing from its first cause to its end, whatever was asked meanwhile; none that began on the floor, where
    this ground led anybody up."""
    found: list[PhaseSpan] = []
    before: Phase | None = None
    for span in flight.phases:
        if span.phase is Phase.LAND and before is Phase.LAND and found:
            found[-1] = replace(found[-1], end_s=span.end_s)
        elif span.phase is Phase.LAND and (before is not Phase.GROUND or not flight.spans(*LED_UP)):
            found.append(span)
        before = span.phase
    return found


def _cuts(flight: Flight, paths: dict[str, Path]) -> Iterator[str]:
    """Motors that were cut in the air: by the swarm's stop, or one drone's alone."""
    for before, span in zip(flight.phases, flight.phases[1:], strict=False):
        if span.phase is Phase.STOPPED and before.phase in AIRBORNE:
            yield span.cause or "emergency stop"
    bodies = {v.sysid: v.body for v in flight.vehicles}
    for t_s, sysid, message in from_ground(flight, COMMANDS):
        height_m = paths[bodies[sysid]].height_at(t_s) if bodies.get(sysid) in paths else 0.0
        if _is_cut(message) and height_m > IN_AIR_M:
            yield f"{bodies[sysid]}: motors cut at {height_m:.2f} m"


def _is_cut(message: object) -> bool:
    if not isinstance(message, CommandLong) or message.command != MavCommand.COMPONENT_ARM_DISARM:
        return False
    return message.params[0] == 0.0 and message.params[1] == DISARM_IN_FLIGHT


def _losses(flight: Flight, drone: Vehicle, path: Path, beats: dict[int, tuple[float, bool]] | None) -> Iterator[str]:
    """What shows that this drone fell, came down elsewhere, or is not known to have come down."""
    lab, name = flight.run.lab, drone.body
    limit_m_s = FALL_OVER_M_S + (lab.flight.descend_m_s if lab is not None else 0.0)
    falls = [speed for t_s, speed in touchdowns(path) if _flown(flight, t_s) and speed > limit_m_s]
    if falls:
        yield f"{name} fell: it met the floor at {max(falls):.1f} m/s, a landing is at most {limit_m_s:.1f} m/s"
    landings = _landings(flight)
    if not landings or flight.phases[-1].phase is Phase.HOLD:
        return
    end_s = landings[-1].end_s
    disarmed = beats is not None and drone.sysid in beats and not beats[drone.sysid][1]
    if beats is not None and not disarmed:
        silent_s = end_s - beats[drone.sysid][0] if drone.sysid in beats else end_s
        if silent_s > UNHEARD_S:
            yield f"{name} unheard for {silent_s:.0f} s, {_last_seen(path, end_s)}"
    if not disarmed and path.height_at(end_s) > IN_AIR_M:
        yield f"{name} {_last_seen(path, end_s)}"
    yield from _position_errors(flight, drone, path, landings[-1])


def _position_errors(flight: Flight, drone: Vehicle, path: Path, landing: PhaseSpan) -> Iterator[str]:
    """Landing points outside the fence, or far from the last reference."""
    lab, seen = flight.run.lab, np.flatnonzero((path.t_s >= landing.start_s) & (path.t_s <= landing.end_s))
    if not len(seen):
        return
    xy_m = path.pos_lab_m[seen[-1], :2]
    if lab is not None:
        fence = lab.limits.fence
        outside_m = float(np.maximum(np.subtract(fence.low_m[:2], xy_m), xy_m - fence.high_m[:2]).max())
        if outside_m > 0.0:
            yield f"{drone.body} came down {outside_m:.2f} m outside the fence"
    led = np.flatnonzero(flight.reference.t_s <= path.t_s[seen[-1]])
    if len(led) and drone.column is not None:
        wanted = reference_lab_m(flight.reference)[led[-1], drone.column, :2]
        if (away_m := float(np.linalg.norm(xy_m - wanted))) > POSITION_ERROR_M:
            yield f"{drone.body} came down {away_m:.2f} m from where it was led"


def touchdowns(path: Path) -> list[tuple[float, float]]:
    """Each time the drone came down to the floor: when, s, and how fast, m/s, over the 0.1 s before."""
    low = path.height_m < NEAR_FLOOR_M
    found = []
    for k in np.flatnonzero(~low[:-1] & low[1:]) + 1:
        first = min(int(np.searchsorted(path.t_s, path.t_s[k] - TOUCH_WINDOW_S)), int(k) - 1)
        dt_s = path.t_s[k] - path.t_s[first]
        found.append((float(path.t_s[k]), float((path.height_m[first] - path.height_m[k]) / dt_s)))
    return found


def _last_seen(path: Path, t_s: float) -> str:
    k = int(np.searchsorted(path.t_s, t_s, "right")) - 1
    if k < 0:
        return "never seen by the mocap"
    where = "in the air" if path.height_m[k] > IN_AIR_M else "near the floor"
    x_m, y_m, z_m = path.pos_lab_m[k]
    return f"last seen {where} at x {x_m:.2f}, y {y_m:.2f}, z {z_m:.2f} m"


def _path(flight: Flight, index: int) -> Path:
    """The drone's path; its heights are above where it was before the first take-off, else above the fence's floor."""
    poses = flight.poses
    seen = poses.seen[:, index]
    t_s, pos_lab_m = poses.t_s[seen], poses.pos_lab_m[seen, index]
    lab, begun = flight.run.lab, flight.spans(*AIRBORNE)[0].start_s
    before = pos_lab_m[t_s < begun, 2]
    floor_m = float(np.median(before)) if len(before) else max(lab.limits.fence.low_m[2], 0.0) if lab else 0.0
    return Path(t_s, pos_lab_m, pos_lab_m[:, 2] - floor_m)


def _last_heartbeats(flight: Flight) -> dict[int, tuple[float, bool]] | None:
    """By system id, the last heartbeat when the last landing was over: when, s, and whether armed.

    None where the log holds no heartbeat.
    """
    landings = _landings(flight)
    if not len(flight.up):
        return None
    end_s = landings[-1].end_s + CONFIRM_S if landings else flight.duration_s
    last: dict[int, tuple[float, bool]] = {}
    for t_s, sysid, message in from_drones(flight, HEARTBEATS):
        if t_s > end_s:
            break
        if isinstance(message, Heartbeat):
            last[sysid] = (t_s, message.armed)
    return last or None


def _flown(flight: Flight, t_s: float) -> bool:
    return any(span.start_s <= t_s <= span.end_s + CONFIRM_S for span in flight.spans(*AIRBORNE))


def _asked_for(flight: Flight, t_s: float) -> bool:
    """Whether the operator had asked for all to land just before t_s, and was not rejected."""
    rejected = {reply.id for reply in flight.replies.messages if not reply.accepted}
    return any(
        request.verb is Verb.LAND
        and not request.argument
        and request.id not in rejected
        and 0.0 <= t_s - asked_s <= 1.0
        for asked_s, request in zip(flight.requests.t_s, flight.requests.messages, strict=True)
    )
