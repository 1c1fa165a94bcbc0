"""The report of one flight: one self-contained HTML page, in words, pictures and numbers, from its log alone."""

import json
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis import words
from analysis.chain import stages
from analysis.links import backlogs
from analysis.load import Flight, load_checked
from analysis.metrics import Latency, Summary, rms, summarise, vibration_of
from analysis.page import Folded, Part, Row, Table, mm, render, table
from analysis.plots import control, motion, style
from analysis.plots.style import Drawing, Missing
from analysis.series import Series, nearest
from analysis.tracking import LeaderTracking, Tracking, in_formation_phase, reference_lab_m, track, track_leader
from formation.maths.arrays import Bool, Float
from formation.messages import Event, Severity, rejection_text
from wire.text import parse_object

MEANINGS = {
    "duration_s": "first to last record of the log",
    "followers": "vehicles holding a slot",
    "formation_rms_m": "length of the formation error in the leader's frame, all followers, settled formation",
    "formation_max_m": "its largest value",
    "leader_rms_m": "length of a commanded leader's tracking error, lab axes, formation phase",
    "leader_max_m": "its largest value",
    "vibration_m": "mean half peak-to-peak about the 1 s moving average, x and y",
    "altitude_rms_m": "the vertical part of the formation error",
    "min_separation_m": "least distance between two vehicles in the air",
    "frames": "mocap frames recorded",
    "law_failures": "failures of the lab's own control law",
    "late_ticks": "control cycles by the watchdog or slower than the frames",
    "mocap_ms": "mocap process has the raw frame to ground has the aligned one, ms: median, 99 %, max",
    "latency_ms": "frame received to last datagram sent: median, 99 %, max",
    "age_ms": "camera to drone, as the drones report it: median, 99 %, max",
    "link_behind_ms": "age of the drones' telemetry when the ground read it, ms: median, 99 %, max",
    "realtime_factor": "simulated seconds per second, lockstep only",
    "command_hash": "SHA-256 of every attitude target sent, in order",
    "outcome": "how the flight ended",
}

PAUSE_S = 5.0
"""A pause longer than this begins a new line."""
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


@dataclass(slots=True)
class FoldedEvent:
    """One event, or several of the same words, whatever their numbers, from first_s to last_s."""

    event: Event
    first_s: float
    last_s: float
    count: int = 1

    @property
    def time(self) -> str:
        """`20.95 s`, `20.95-21.47 s`."""
        span = f"{self.first_s:.2f}"
        return f"{span} s" if self.count == 1 else f"{span}-{self.last_s:.2f} s"

    @property
    def text(self) -> str:
        """`23 x setpoints stale`; where numbers in the text differ, the first ones."""
        return self.event.text if self.count == 1 else f"{self.count} x {self.event.text}"


def report(path_mcap: Path, path_html: Path | None = None) -> Path:
    """Write the report of a log, by default beside it as report.html; returns the path.

    Works on truncated logs and on flights with missing topics: a section says what is missing.
    """
    path_html = path_mcap.with_name("report.html") if path_html is None else path_html
    flight, checked = load_checked(path_mcap)
    write(
        flight,
        summarise(flight, mcap=path_mcap, report=path_html),
        path_html,
        "" if checked.complete else checked.damage,
    )
    return path_html


def write(flight: Flight, summary: Summary, path_html: Path, damage: str = "") -> None:
    """Write the page of a flight whose summary is known; damage: what is wrong with its file, in words."""
    path_html.write_text(html(flight, summary, damage), encoding="utf-8")


def html(flight: Flight, summary: Summary, damage: str = "") -> str:
    """The page of a flight; its prose is in `report.html`."""
    tracking = track(flight)
    lab = flight.run.lab
    name = (flight.run.scenario or ("flight" if lab is None else lab.name)).replace("_", " ").capitalize()
    return render(
        "report.html",
        title=f"{name} · flight report",
        name=name,
        good=summary.outcome.is_good,
        facts=_facts(flight, summary),
        data=downloads(summary.mcap, summary.report),
        damage=damage,
        summary=summary,
        cycles=len(flight.timing) or summary.frames,
        flown=words.flown(flight),
        happened=words.happened(flight, tracking, summary),
        findings=words.findings(flight, tracking, summary),
        pictures=drawings(flight, tracking),
        events=(*_event_tables(flight), _rejection_table(flight)),
        altitudes=altitudes(flight),
        followers=_follower_table(flight, tracking),
        leader=_leader_table(track_leader(flight)),
        backlog=_backlog_table(flight),
        chain=_chain_table(flight),
        setup=setup(flight),
        metrics=table(("`key", "#value", "meaning"), [(key, _value(key, summary), of) for key, of in MEANINGS.items()]),
        versions=flight.run.versions,
    )


def _facts(flight: Flight, summary: Summary) -> list[str]:
    """Date, length, size, link and seed, as far as they are known."""
    date = flight.run.metadata.get("date", "").replace("T", " ").replace("Z", " UTC")
    facts = [date] if date else []
    facts += [f"{summary.duration_s:.1f} s", words.counted(len(flight.vehicles), "vehicle")]
    facts += [f"link: {summary.link}"] if summary.link else []
    return facts + ([f"seed {summary.seed}"] if summary.seed is not None else [])


def drawings(flight: Flight, tracking: Tracking) -> dict[str, tuple[Drawing, ...]]:
    """Every picture of the report, by section."""
    leader = track_leader(flight)
    with style.styled():
        return {
            "timeline": (style.timeline(flight),),
            "paths": (motion.where(flight), motion.heights(flight)),
            "leader": (motion.leader_error(flight, leader), motion.leader_positions(flight)),
            "error": (motion.errors(flight, tracking),),
            "clouds": (motion.clouds(flight, tracking),),
            "positions": (motion.positions(flight, tracking),),
            "sliding": (control.sliding(flight), control.disturbance(flight)),
            "output": (control.output(flight),),
            "attitude": (control.attitude(flight, tracking),),
            "link": (control.link(flight),),
            "timing": (control.histograms(flight), control.cycles(flight)),
        }


def _event_tables(flight: Flight) -> tuple[Part, ...]:
    """The first events that an operator must know, and all others folded away; repeated events are one line."""
    every = folded(flight.events)
    if not every:
        return (Missing("no event was recorded"),)
    notable = folded(flight.events, Severity.NOTICE)[:20]
    if len(notable) == len(every):
        return (_events(every),)
    return _events(notable), Folded(f"All {len(flight.events)} events", _events(every))


def _events(lines: list[FoldedEvent]) -> Table | None:
    """A table of events."""
    rows = [
        Row((line.time, line.event.severity.name.lower(), line.event.source, line.text),
            alarming=line.event.severity < Severity.WARNING)
        for line in lines
    ]  # fmt: skip
    return table(("@time", "~level", "source", "what"), rows)


def _rejection_table(flight: Flight) -> Table | None:
    """Poses that were not believed, where there are any."""
    rows = [
        (one.body, one.reason, f"{one.frames}", f"{one.stretches}", f"{one.first_s:.2f} s", f"{one.last_s:.2f} s")
        for one in rejections(flight)
    ]
    return table(("body", "its pose was not believed:", "#frames", "#times", "@first", "@last"), rows)


def _follower_table(flight: Flight, tracking: Tracking) -> Table | None:
    """One row a follower: RMS, largest, mean and vibration."""
    head = ("follower", "#RMS, mm", "#max, mm", "#forward, mm", "#left, mm", "#up, mm", "#vibration, mm")
    colours = style.colours(len(flight.vehicles))
    rows = []
    for k, vehicle in enumerate(flight.followers):
        error = tracking.error_lead_m[tracking.scored[:, k], k]
        if len(error):
            cells = (vehicle.body, *_statistics(error), mm(vibration_of(tracking, k)))
            rows.append(Row(cells, colours[k + 1]))
    return table(head, rows)


def _statistics(error_m: Float) -> list[str]:
    """RMS and largest length, then mean and spread along each axis, mm, of errors (T, 3)."""
    length_m = np.linalg.norm(error_m, axis=1)
    along = zip(error_m.mean(axis=0), error_m.std(axis=0), strict=True)
    return [mm(rms(length_m)), mm(float(length_m.max())), *(f"{1e3 * m:+.2f} ± {1e3 * s:.2f}" for m, s in along)]


def _backlog_table(flight: Flight) -> Table | None:
    """One row a link: how old telemetry was when the ground read it, and what was dropped for newer."""
    names = {vehicle.sysid: (vehicle.body, i) for i, vehicle in enumerate(flight.vehicles)}
    colours = style.colours(len(flight.vehicles))
    rows = []
    for link in backlogs(flight):
        if link.sysid in names and len(link.behind_ms):
            body, i = names[link.sysid]
            ages = (*np.percentile(link.behind_ms, (50.0, 99.0)), link.behind_ms.max())
            rows.append(Row((body, *(f"{age:.3g}" for age in ages), f"{link.superseded}"), colours[i]))
    return table(("telemetry of", "#age when read, median, ms", "#99 %, ms", "#worst, ms", "#packets superseded"), rows)


def _chain_table(flight: Flight) -> Table | None:
    """One row a stage from the ground's target to the motors, by the drones' joined logs; the longest marked."""
    found = stages(flight)
    longest = max((stage.delay_s for stage in found), default=0.0)
    rows = [
        Row((stage.body, stage.name, f"{1e3 * stage.delay_s:.1f}", f"{stage.alike:.2f}"),
            alarming=stage.delay_s == longest)
        for stage in found
    ]  # fmt: skip
    return table(("drone", "stage", "#delay, ms", "#correlation"), rows)


def _leader_table(leader: LeaderTracking) -> Table | None:
    """RMS, largest, and mean and spread along each axis of lab."""
    head = ("#RMS, mm", "#max, mm", *(f"#{axis}, mm" for axis in "xyz"))
    return table(head, [_statistics(leader.error_lab_m)] if len(leader.t_s) else [])


def _value(key: str, summary: Summary) -> str:
    """A number of the summary as a person reads it."""
    value = getattr(summary, key)
    match value:
        case None:
            return "–"
        case Latency():
            return f"{value.p50:.3g} / {value.p99:.3g} / {value.max:.3g}"
        case float():
            return f"{value:.5g}"
    return f"{value[:16]}…" if key == "command_hash" else f"{value}"


@dataclass(frozen=True, slots=True)
class Rejected:
    """One body's poses that were rejected for one reason; frames: how many, in `stretches`, s from the log's start."""

    body: str
    reason: str
    frames: int
    stretches: int
    first_s: float
    last_s: float


def rejections(flight: Flight) -> tuple[Rejected, ...]:
    """All there are, in order of their first."""
    poses = flight.poses
    found = []
    for i, vehicle in enumerate(flight.vehicles):
        codes = poses.rejected[:, i] if len(poses.t_s) else np.zeros(0, np.uint8)
        for code in np.unique(codes[codes > 0]).tolist():
            met = codes == code
            begins = int(met[0]) + int((met[1:] & ~met[:-1]).sum())
            t_s = poses.t_s[met]
            reason = rejection_text(code)
            found.append(Rejected(vehicle.body, reason, int(met.sum()), begins, float(t_s[0]), float(t_s[-1])))
    return tuple(sorted(found, key=lambda one: one.first_s))


def altitudes(flight: Flight) -> Table | None:
    """One row a vehicle, over the formation phase; None where it was not flown."""
    colours, rows = style.colours(len(flight.vehicles)), []
    for i, vehicle in enumerate(flight.vehicles):
        mean_m, commanded_m = _measured_m(flight, i), _commanded_m(flight, i, vehicle.column)
        if mean_m is None:
            continue
        error = "–" if commanded_m is None else f"{1e3 * (mean_m - commanded_m):+.2f}"
        commanded = "–" if commanded_m is None else f"{commanded_m:.4f}"
        configured = "–" if flight.run.lab is None else f"{flight.run.lab.flight.altitude_m:.3f}"
        rows.append(Row((vehicle.body, f"{mean_m:.4f}", commanded, error, configured), colours[i]))
    return table(("vehicle", "#mean altitude, m", "#commanded, m", "#error, mm", "#take-off to, m"), rows)


def _measured_m(flight: Flight, i: int) -> float | None:
    if not len(flight.poses):
        return None
    chosen = _formed(flight, i, flight.poses.t_s) & flight.poses.seen[:, i]
    return float(flight.poses.pos_lab_m[chosen, i, 2].mean()) if chosen.any() else None


def _formed(flight: Flight, i: int, t_s: Float) -> Bool:
    """When vehicle i was in formation (T,): a follower that lands alone is so no more."""
    formed, reference, column = in_formation_phase(flight, t_s), flight.reference, flight.vehicles[i].column
    if i == 0 or column is None or not len(reference):
        return formed
    held: Bool = formed & (reference["in_formation"][nearest(reference.t_s, t_s), column])
    return held


def _commanded_m(flight: Flight, i: int, column: int | None) -> float | None:
    if column is None or not len(flight.reference):
        return None
    chosen = _formed(flight, i, flight.reference.t_s)
    return float(reference_lab_m(flight.reference)[chosen, column, 2].mean()) if chosen.any() else None


@dataclass(frozen=True, slots=True)
class Data:
    """Where a report's data are, relative to the page: the log, and the tables that `gcs-log export` makes of it.

    tables: their folder without its ending, `-csv` or `-parquet`; it exists once they have been exported.
    """

    name: str
    log: str
    tables: str


def downloads(mcap: str | None, report: str | None) -> Data | None:
    """The data of a page; None where no file is known."""
    if mcap is None or report is None:
        return None
    beside = Path(os.path.relpath(Path(mcap).resolve(), Path(report).resolve().parent))
    return Data(beside.name, beside.as_posix(), beside.with_suffix("").as_posix())


def folded(events: Series[Event], least: Severity = Severity.DEBUG) -> list[FoldedEvent]:
    """The events at least that severe, in order of their first time."""
    lines: list[FoldedEvent] = []
    newest: dict[tuple[Severity, str, str], FoldedEvent] = {}
    for t_s, event in zip(events.t_s.tolist(), events.messages, strict=True):
        if event.severity > least:
            continue
        key = (event.severity, event.source, _NUMBER.sub("#", event.text))
        line = newest.get(key)
        if line is not None and t_s - line.last_s <= PAUSE_S:
            line.last_s, line.count = t_s, line.count + 1
        else:
            newest[key] = FoldedEvent(event, t_s, t_s)
            lines.append(newest[key])
    return lines


SETUP_FACTS = (
    ("date", "date"), ("versions", "version"), ("machine", "machine"), ("lab_file", "lab file"),
    ("control_law", "control law"), ("scenario", "scenario"), ("seed", "seed"), ("link", "link"),
    ("speed", "speed of the clock"), ("security", "protection of the links"),
)  # fmt: skip


def setup(flight: Flight) -> tuple[Part, ...]:
    """Facts, gains by vehicle kind, profiles, and the whole configuration folded away."""
    metadata, lab = flight.run.metadata, flight.run.lab
    facts = table(("", ""), [(name, metadata[key]) for key, name in SETUP_FACTS if metadata.get(key)])
    if facts is None and lab is None:
        return (Missing("the log says nothing of what it was flown with"),)
    parts: list[Part] = [facts]
    for key, title in (("gains", "Gains and observers"), ("profiles", "Vehicle profiles")):
        for name, values in _objects(metadata.get(key, "")).items():
            parts.append(Folded(f"{title}: {name}", table(("`key", "value"), _flat(values))))
    if lab is not None:
        text = json.dumps(lab.model_dump(mode="json"), indent=2)
        parts.append(Folded("The lab's whole configuration", text=text))
    return tuple(parts)


def _objects(text: str) -> Mapping[str, Mapping[str, object]]:
    """The object of objects in a log's metadata; none where it is anything else."""
    try:
        found = parse_object(text)
    except ValueError:
        return {}
    return {name: values for name, values in found.items() if isinstance(values, dict)}


def _flat(values: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, f"{value:.6g}" if isinstance(value, float) else str(value)
