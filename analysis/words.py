"""A flight in plain words: what was flown, what happened, what deserves attention. Text only, no markup."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.load import Flight
from analysis.metrics import Summary
from analysis.reading import IMPORTED
from analysis.tracking import Tracking, in_formation_phase
from formation.codes import EventCode, FlightResult, Outcome
from formation.config import FollowerConfig, LabConfig, TrajectoryConfig
from formation.messages import Phase, Saturation, Severity

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")
DIRECTIONS = (("ahead of", "behind"), ("left of", "right of"), ("above", "below"))
LEADER_FAR_M = 0.02
GAP_FRAMES = 2.5  # a wait longer than this many usual frame spacings is a gap

MEMBERSHIP = (EventCode.SHAPE, EventCode.TRAJECTORY, EventCode.EXCLUDED, EventCode.REPLACED, EventCode.RELEASED)
"""Events by which the formation became another one: its shape, its way, who flies in it."""


@dataclass(frozen=True, slots=True)
class Remark:
    """Something to look at: `alarming` or merely worth knowing, and the section of the report that shows it."""

    alarming: bool
    text: str
    section: str


def mm(metres: float | None) -> str:
    """Metres as millimetres with three significant digits."""
    if metres is None:
        return "unknown"
    return f"{1e3 * metres:.0f} mm" if abs(metres) >= 0.1 else f"{1e3 * metres:.3g} mm"


def counted(number: int, noun: str) -> str:
    """`two followers`, `one drone`, `23 frames`."""
    word = NUMBERS[number] if number < len(NUMBERS) else f"{number}"
    return f"{word} {noun}" if number == 1 else f"{word} {noun}s"


def times(number: int) -> str:
    """`once`, `twice`, `three times`."""
    return {1: "once", 2: "twice"}.get(number) or counted(number, "time")


def listed(names: tuple[str, ...]) -> str:
    """`a, b and c`."""
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}" if names else "nobody"


def flown(flight: Flight) -> str:
    """What was flown: the vehicles, the leader's path, the slots, the link."""
    if not flight.vehicles:
        return "The log has neither a configuration nor a mocap frame: what was flown is unknown."
    if IMPORTED in flight.run.metadata:
        return f"Another recorder's log of {listed(tuple(v.body for v in flight.vehicles))}, imported."
    leader = flight.leader.body
    commanded = flight.leader.column is not None
    lab = flight.run.lab
    role = "a drone flown by the same ground station" if commanded else "a body that is only observed"
    task = f" with the task to {_path(lab.leader.trajectory)}" if commanded and lab is not None else ""
    names = tuple(v.body for v in flight.followers)
    text = f"{counted(len(names), 'follower').capitalize()} ({listed(names)}) held formation on {leader}, {role}{task}"
    text += f"; link: {flight.run.link}." if flight.run.link else "."
    if lab is None:
        return text + " The log carries no configuration; bodies are named as the mocap names them."
    law = lab.control_law
    own = f" In formation the followers flew by the lab's own control law {law.name}." if law is not None else ""
    return f"{text} {_slots(lab, leader)} Control preset: {lab.control_preset}.{own}"


def _path(path: TrajectoryConfig) -> str:
    """The leader's trajectory as a verb phrase."""
    turning = f", yawing at {path.yaw_rate_rad_s:g} rad/s" if path.yaw_rate_rad_s else ""
    match path.kind:
        case "line":
            return f"fly {path.length_m:g} m straight ahead in {path.duration_s:g} s{turning}"
        case "circle":
            return f"fly circles of {path.radius_m:g} m radius, one in {path.period_s:g} s{turning}"
        case "waypoints":
            return f"fly through {counted(len(path.waypoints_m), 'waypoint')} at {path.speed_m_s:g} m/s{turning}"
        case "figure8":
            return f"fly figures of eight, {path.length_m:g} m long, one in {path.period_s:g} s{turning}"
        case "lissajous":
            return (
                f"fly Lissajous's figure, {listed(tuple(map(str, path.cycles)))} cycles in {path.period_s:g} s{turning}"
            )
        case "polynomial":
            points = counted(len(path.waypoints_m), "waypoint")
            return f"fly through {points} without stopping, at up to {path.speed_m_s:g} m/s{turning}"
        case "file" | "own":
            return f"fly the way of {path.file or path.name}, {path.points[-1][0]:.1f} s long{turning}"
        case "hold":
            return f"hold its place{turning}"


def _slots(lab: LabConfig, leader: str) -> str:
    """Where the slots are, for as many followers as a sentence carries."""
    if len(lab.followers) > 4:
        return f"The slots lie up to {max(np.linalg.norm(f.offset_m) for f in lab.followers):.2f} m from it."
    return " ".join(f"The slot of {f.body} is {_slot(f, leader)}." for f in lab.followers)


def _slot(follower: FollowerConfig, leader: str) -> str:
    """One slot: `0.4 m behind and 0.4 m left of lead`."""
    parts = [
        f"{abs(metres):g} m {words[0] if metres > 0.0 else words[1]}"
        for metres, words in zip(follower.offset_m, DIRECTIONS, strict=True)
        if metres
    ]
    return f"{listed(tuple(parts))} {leader}" if parts else f"at the place of {leader}"


def happened(flight: Flight, tracking: Tracking, summary: Summary) -> str:
    """What happened: the phases in order, how well the formation held, how it ended."""
    without = "The log holds no phases: what follows covers everything that was recorded."
    if not flight.phases and summary.outcome.result is not FlightResult.IMPORTED:
        return without
    verbs = {
        Phase.ARMED: "armed",
        Phase.TAKEOFF: "took off",
        Phase.FORMATION: "entered formation",
        Phase.HOLD: "held position",
        Phase.LAND: "began to land",
        Phase.STOPPED: "was stopped",
    }
    steps = [f"{verbs[s.phase]} at {s.start_s:.1f} s" for s in flight.phases if s.phase in verbs]
    if flight.phases and flight.phases[-1].phase is Phase.GROUND and len(steps) > 1:
        steps.append(f"was back on the ground at {flight.phases[-1].start_s:.1f} s")
    text = f"The swarm {listed(tuple(steps))}. " if steps else "Nothing left the ground. "
    text = text if flight.phases else f"{without} "
    text += "".join(
        f"At {t_s:.1f} s: {event.text}. "
        for t_s, event in zip(flight.events.t_s, flight.events.messages, strict=True)
        if event.code in MEMBERSHIP
    )
    if tracking.scored.any():
        rate_hz = 1.0 / float(np.median(np.diff(tracking.t_s)))
        scored_s = float(tracking.scored.any(axis=1).sum()) / rate_hz
        text += (
            f"Over {scored_s:.1f} s of settled formation the error was {mm(summary.formation_rms_m)} RMS and at most "
            f"{mm(summary.formation_max_m)}; vibration {mm(summary.vibration_m)}. "
        )
    if summary.leader_rms_m is not None:
        text += (
            f"{flight.leader.body} itself tracked its reference to {mm(summary.leader_rms_m)} RMS, "
            f"{mm(summary.leader_max_m)} at most. "
        )
    return text + _ending(summary.outcome)


_ENDINGS = {
    FlightResult.LOST: "A drone was lost",
    FlightResult.CUT: "Motors were cut in the air",
    FlightResult.LAW_FAILED: "It ended well, but not by the lab's own law",
}


def _ending(outcome: Outcome) -> str:
    """The outcome as a sentence."""
    match outcome.result:
        case FlightResult.LANDED:
            return "All landed as asked."
        case FlightResult.IMPORTED:
            return "The log is another recorder's, which does not say how it ended."
        case FlightResult.HELD:
            return "The record ends with the swarm holding its place in the air."
        case FlightResult.STARVED:
            return f"No flight: {outcome.reason}."
    return f"{_ENDINGS.get(outcome.result, 'The flight did not end as planned')}: {outcome.reason}."


def findings(flight: Flight, tracking: Tracking, summary: Summary) -> tuple[Remark, ...]:
    """What deserves a look, alarming things first."""
    every = [
        *_outcome(summary),
        *_separation(flight, summary),
        *_events(flight),
        *_late(flight, summary),
        *_gaps(flight),
        *_unseen(flight),
        *_limits(flight),
        *_largest_error(flight, tracking),
        *_bias(flight, tracking),
        *_leader(flight, summary),
    ]
    return tuple(sorted(every, key=lambda finding: not finding.alarming))


def _outcome(summary: Summary) -> Iterator[Remark]:
    outcome = summary.outcome
    if outcome.result is FlightResult.STARVED:
        yield Remark(True, f"A simulator came too late: {outcome.reason}.", "timeline")
    elif not outcome.is_good:
        ending = _ENDINGS.get(outcome.result, "The flight ended early")
        yield Remark(True, f"{ending}: {outcome.reason}.", "timeline")


def _separation(flight: Flight, summary: Summary) -> Iterator[Remark]:
    lab, least = flight.run.lab, summary.min_separation_m
    if lab is not None and least is not None and least < lab.limits.min_separation_m:
        wanted = lab.limits.min_separation_m
        yield Remark(
            True, f"Two vehicles came within {least:.2f} m of each other; the limit is {wanted:.2f} m.", "paths"
        )


def _events(flight: Flight) -> Iterator[Remark]:
    loud = [e for e in flight.events.messages if e.severity <= Severity.WARNING]
    if loud:
        worst = min(loud, key=lambda event: event.severity)
        more = f" and {counted(len(loud) - 1, 'more warning')}" if len(loud) > 1 else ""
        yield Remark(
            worst.severity < Severity.WARNING, f"{worst.source.capitalize()} reported “{worst.text}”{more}.", "timeline"
        )


def _late(flight: Flight, summary: Summary) -> Iterator[Remark]:
    if summary.late_ticks and summary.latency_ms is not None:
        share = 100.0 * summary.late_ticks / len(flight.timing)
        late = counted(summary.late_ticks, "control cycle").capitalize()
        text = f"{late} came late ({share:.2g} %), the slowest {summary.latency_ms.max:.3g} ms."
        yield Remark(share > 1.0, text, "timing")


def _gaps(flight: Flight) -> Iterator[Remark]:
    spacing_s = np.diff(flight.poses.t_s)
    if not spacing_s.size:
        return
    usual_s = float(np.median(spacing_s))
    gaps = np.flatnonzero(spacing_s > GAP_FRAMES * usual_s)
    if gaps.size:
        widest = int(gaps[np.argmax(spacing_s[gaps])])
        text = (
            f"The mocap paused {times(gaps.size)}, the longest for {1e3 * spacing_s[widest]:.0f} ms "
            f"at {flight.poses.t_s[widest]:.1f} s (frames usually come every {1e3 * usual_s:.1f} ms)."
        )
        yield Remark(float(spacing_s[widest]) > 0.1, text, "timing")


def _unseen(flight: Flight) -> Iterator[Remark]:
    for i, vehicle in enumerate(flight.vehicles):
        lost = int((~flight.poses.seen[:, i]).sum())
        if lost:
            share = 100.0 * lost / len(flight.poses)
            yield Remark(share > 5.0, f"{vehicle.body} was not seen in {lost} frames ({share:.2g} %).", "paths")


def _limits(flight: Flight) -> Iterator[Remark]:
    bits = flight.target["saturation"].astype(np.int64)
    bits = bits[in_formation_phase(flight, flight.target.t_s)] if len(flight.target) else bits
    if not bits.size:
        return
    for limit in Saturation:
        share = 100.0 * float(np.mean((bits & limit) != 0))
        if limit is not Saturation.NONE and share > 0.0:
            name = (limit.name or "").lower().replace("_", " ")
            text = f"The {name} limit cut {share:.2g} % of the attitude targets sent in formation."
            yield Remark(share > 5.0, text, "output")


def _largest_error(flight: Flight, tracking: Tracking) -> Iterator[Remark]:
    if not tracking.scored.any():
        return
    length_m = np.where(tracking.scored, np.linalg.norm(tracking.error_lead_m, axis=-1), -1.0)
    frame, follower = np.unravel_index(int(np.argmax(length_m)), length_m.shape)
    t_s, worst_m = float(tracking.t_s[frame]), float(length_m[frame, follower])
    name = flight.followers[int(follower)].body
    near = [
        event.text
        for at_s, event in zip(flight.events.t_s, flight.events.messages, strict=True)
        if abs(at_s - t_s) < 0.5 and event.severity <= Severity.WARNING
    ]
    why = f", around the event “{near[0]}”" if near else ""
    yield Remark(False, f"The largest error is {mm(worst_m)}, {name} at {t_s:.1f} s{why}.", "error")


def _leader(flight: Flight, summary: Summary) -> Iterator[Remark]:
    """A leader that is held worse than its followers: the formation moves as a whole, without a formation error."""
    leader_m, formation_m = summary.leader_rms_m, summary.formation_rms_m
    if leader_m is None or formation_m is None or leader_m <= max(2.0 * formation_m, LEADER_FAR_M):
        return
    text = (
        f"{flight.leader.body} is {mm(leader_m)} RMS off its own reference, the followers {mm(formation_m)} off theirs."
    )
    yield Remark(False, text, "leader")


def _bias(flight: Flight, tracking: Tracking) -> Iterator[Remark]:
    """Steady offsets: where an error's mean outweighs its scatter, trim or alignment is the likelier cause."""
    names = ("forward", "left", "up")
    for k, vehicle in enumerate(flight.followers):
        error = tracking.error_lead_m[tracking.scored[:, k], k]
        if not len(error):
            continue
        mean, std = error.mean(axis=0), error.std(axis=0)
        axis = int(np.argmax(np.abs(mean)))
        if abs(mean[axis]) > 2.0 * std[axis] and abs(mean[axis]) > 5e-4:
            offset = f"{mm(float(mean[axis]))} {names[axis]}"
            text = f"{vehicle.body} stands off steadily by {offset}: look at trim or marker alignment."
            yield Remark(False, text, "clouds")
