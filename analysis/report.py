"""The report of one flight: one self-contained HTML page, in words, pictures and numbers, from its log alone."""

import json
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from analysis import page, words
from analysis.links import backlogs
from analysis.load import Flight, load_checked
from analysis.metrics import Latency, Summary, rms, summarise, vibration_of
from analysis.outcome import GOOD
from analysis.page import Section, cell, picture, row, swatch, table, text, tile
from analysis.plots import control, motion, style
from analysis.plots.style import Drawing
from analysis.series import Series
from analysis.tracking import LeaderTracking, Tracking, in_formation_phase, reference_lab_m, track, track_leader
from formation.messages import Event, Severity, rejection_text
from wire.text import parse_json

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
    "age_ms": "camera to drone, as the drones report it: median, 99 %",
    "link_behind_ms": "age of the drones' telemetry when the ground read it, ms: median, 99 %, max",
    "realtime_factor": "simulated seconds per second, lockstep only",
    "command_hash": "SHA-256 of every attitude target sent, in order",
    "outcome": "how the flight ended",
}

TEXTS = (
    (
        "timeline",
        "Timeline",
        "Phases of the swarm, operator requests, and what the ground reported (red: error, amber: warning).",
    ),
    (
        "paths",
        "Paths",
        "Strong lines are the formation phase, faint ones the rest; dots joined to the leader are the formation "
        "at even times. The dashed outline is the fence. Below, heights over time, and mean altitudes in formation.",
    ),
    (
        "error",
        "Formation error",
        "Each follower's distance from its slot, measured by mocap in the leader's own frame. Thin lines: the "
        "slot itself is still moving (entry, change of shape); those frames are not scored.",
    ),
    (
        "leader",
        "Leader tracking error",
        "How far a commanded leader is from its own reference, measured by mocap, lab axes, formation phase. The "
        "followers hold their slots on the leader as it is, so this is in no formation error. Below, its position "
        "against the reference (dashed).",
    ),
    (
        "clouds",
        "Where the error points",
        "Horizontal error of every scored frame about the slot, forward up. A round cloud on the cross is noise; "
        "a cloud off the cross is trim or alignment; a streak forward is the leader's acceleration or lag.",
    ),
    (
        "positions",
        "Position against reference",
        "Each follower in lab axes (colour), its reference dashed over it; of many, the six with the largest error.",
    ),
    (
        "sliding",
        "Sliding variable and disturbance",
        "s should stay in a narrow band about zero; Z3 is what the observer believes pushes the drone: wind, "
        "ground effect, a wrong mass (z). The scales are those of the formation phase.",
    ),
    (
        "output",
        "Control output",
        "Acceleration demanded by the law (gravity excluded), the thrust sent, a mark wherever a limit cut it.",
    ),
    (
        "attitude",
        "Attitude against target",
        "Tilt measured by mocap (colour) over its target (grey). In the close-up the shift to the right is the "
        "vehicle's lag.",
    ),
    (
        "timing",
        "Timing",
        "Counts are on a log scale: the rare late cycle matters more than the common punctual one.",
    ),
    (
        "link",
        "Battery and link",
        "What each drone said of itself, as the ground heard it. Silence is the time since its last packet; "
        "losses are counted by the packets' own numbers. Below, what waited on each link.",
    ),
    (
        "setup",
        "Flown with",
        "What this log says of its own making; all of it is in the file.",
    ),
    (
        "metrics",
        "Metrics",
        "The summary, with the keys under which --json writes it.",
    ),
)
"""Every section in reading order: anchor, heading, what to look for."""


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
    """The page of a flight."""
    tracking = track(flight)
    body = [_header(flight, summary, damage), _tiles(flight, summary), _story(flight, tracking, summary)]
    body += [section.html() for section in _sections(flight, tracking, summary)]
    body.append(_footer(flight))
    return page.document(f"{_name(flight)} · flight report", "\n".join(body))


def _name(flight: Flight) -> str:
    """The flight's name for people."""
    return (flight.run.scenario or "flight").replace("_", " ").capitalize()


def _header(flight: Flight, summary: Summary, damage: str) -> str:
    date = flight.run.metadata.get("date", "").replace("T", " ").replace("Z", " UTC")
    facts = [date] if date else []
    facts += [f"{summary.duration_s:.1f} s", words.counted(len(flight.vehicles), "vehicle")]
    facts += [f"link: {summary.link}"] if summary.link else []
    facts += [f"seed {summary.seed}"] if summary.seed is not None else []
    good = summary.outcome in GOOD
    badge = f'<span class="outcome{"" if good else " bad"}">{escape(summary.outcome.split(":")[0])}</span>'
    harm = (
        f'<p class="damage">The log is damaged: {text(damage)}. This report shows what it still holds.</p>'
        if damage
        else ""
    )
    return (
        f'<header><p class="kind">Flight report</p><h1>{escape(_name(flight))}{badge}</h1>'
        f'<p class="facts">{escape(" · ".join(facts))}</p>{downloads(summary.mcap, summary.report)}{harm}</header>'
    )


def _tiles(flight: Flight, summary: Summary) -> str:
    """The numbers a pilot asks for first."""
    latency = "–" if summary.latency_ms is None else f"{summary.latency_ms.p99:.2g}"
    separation = "–" if summary.min_separation_m is None else f"{summary.min_separation_m:.2f}"
    return '<div class="tiles">' + "".join(
        (
            tile(*_mm(summary.formation_rms_m), "formation error, RMS"),
            tile(*_mm(summary.formation_max_m), "formation error, largest"),
            tile(*_mm(summary.leader_rms_m), "leader tracking error, RMS"),
            tile(*_mm(summary.vibration_m), "vibration amplitude"),
            tile(separation, "m", "least separation in the air"),
            tile(latency, "ms", "control latency, 99 %"),
            tile(f"{summary.late_ticks}", f"of {len(flight.timing) or summary.frames}", "late control cycles"),
        )
    ) + "</div>"  # fmt: skip


def _mm(metres: float | None) -> tuple[str, str]:
    """A value and its unit; a dash where unknown."""
    return ("–", "mm") if metres is None else (f"{1e3 * metres:.3g}", "mm")


def _story(flight: Flight, tracking: Tracking, summary: Summary) -> str:
    """The flight in words: what was flown and what happened at the left, what to look at on the right."""
    items = "".join(
        f'<li{" class=alarming" if f.alarming else ""}>{text(f.text)} <a href="#{f.section}">{f.section}</a></li>'
        for f in words.findings(flight, tracking, summary)
    )
    remarks = f'<ul class="findings">{items}</ul>' if items else "<p>Nothing out of the ordinary.</p>"
    return (
        f'<div class="story"><div><h2>What was flown</h2><p>{text(words.flown(flight))}</p>'
        f"<h2>What happened</h2><p>{text(words.happened(flight, tracking, summary))}</p></div>"
        f"<div><h2>What to look at</h2>{remarks}</div></div>"
    )


def _sections(flight: Flight, tracking: Tracking, summary: Summary) -> Iterator[Section]:
    """Every section, finished."""
    pictures = drawings(flight, tracking)
    tables = {
        "paths": altitudes(flight),
        "timeline": _event_table(flight) + _rejection_table(flight),
        "error": _follower_table(flight, tracking),
        "leader": _leader_table(track_leader(flight)),
        "link": _backlog_table(flight),
        "setup": setup(flight),
        "metrics": _metric_table(summary),
    }
    for anchor, title, lead in TEXTS:
        drawn = tuple(picture(drawing, title) for drawing in pictures.get(anchor, ()))
        yield Section(anchor, title, lead, (*drawn, tables.get(anchor, "")))


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


def _event_table(flight: Flight) -> str:
    """The events that an operator must know, and all others folded away; repeated events are one line."""
    every = folded(flight.events)
    if not every:
        return '<p class="missing">Not shown: no event was recorded.</p>'
    notable = folded(flight.events, Severity.NOTICE)
    rest = f"<details><summary>All {len(flight.events)} events</summary>{_events(every)}</details>"
    return _events(notable) + rest if len(notable) < len(every) else _events(every)


def _events(lines: list[FoldedEvent]) -> str:
    """A table of events."""
    rows = [
        row(
            cell(line.time, "time"),
            cell(line.event.severity.name.lower(), "level"),
            cell(line.event.source),
            cell(line.text),
            alarming=line.event.severity < Severity.WARNING,
        )
        for line in lines
    ]
    return table(("time", "level", "source", "what"), rows) if rows else ""


def _rejection_table(flight: Flight) -> str:
    """Poses that were not believed, where there are any."""
    rows = [
        row(
            cell(one.body), cell(one.reason), cell(f"{one.frames}", "number"), cell(f"{one.stretches}", "number"),
            cell(f"{one.first_s:.2f} s", "time"), cell(f"{one.last_s:.2f} s", "time"),
        )
        for one in rejections(flight)
    ]  # fmt: skip
    head = ("body", "its pose was not believed:", "#frames", "#times", "first", "last")
    return table(head, rows) if rows else ""


def _follower_table(flight: Flight, tracking: Tracking) -> str:
    """One row a follower: RMS, largest, mean and vibration."""
    head = ("follower", "#RMS, mm", "#max, mm", "#forward, mm", "#left, mm", "#up, mm", "#vibration, mm")
    colours = style.colours(len(flight.vehicles))
    rows = []
    for k, vehicle in enumerate(flight.followers):
        error = tracking.error_lead_m[tracking.scored[:, k], k]
        if not len(error):
            continue
        length = np.linalg.norm(error, axis=1)
        stats = [f"{1e3 * m:+.2f} ± {1e3 * s:.2f}" for m, s in zip(error.mean(axis=0), error.std(axis=0), strict=True)]
        shaking = vibration_of(tracking, k)
        numbers = (_mm(rms(length))[0], _mm(float(length.max()))[0], *stats, _mm(shaking)[0])
        rows.append(row(swatch(vehicle.body, colours[k + 1]), *(cell(n, "number") for n in numbers)))
    return table(head, rows) if rows else ""


def _backlog_table(flight: Flight) -> str:
    """One row a link: how old telemetry was when the ground read it, and what was dropped for newer."""
    names = {vehicle.sysid: (vehicle.body, i) for i, vehicle in enumerate(flight.vehicles)}
    colours = style.colours(len(flight.vehicles))
    rows = []
    for link in backlogs(flight):
        if link.sysid not in names or not len(link.behind_ms):
            continue
        body, i = names[link.sysid]
        ages = (*np.percentile(link.behind_ms, (50.0, 99.0)), link.behind_ms.max())
        numbers = (*(f"{age:.3g}" for age in ages), f"{link.superseded}")
        rows.append(row(swatch(body, colours[i]), *(cell(number, "number") for number in numbers)))
    head = ("telemetry of", "#age when read, median, ms", "#99 %, ms", "#worst, ms", "#packets superseded")
    return table(head, rows) if rows else ""


def _leader_table(leader: LeaderTracking) -> str:
    """RMS, largest, and mean and spread along each axis of lab."""
    if not len(leader.t_s):
        return ""
    length = np.linalg.norm(leader.error_lab_m, axis=1)
    head = ("#RMS, mm", "#max, mm", *(f"#{axis}, mm" for axis in "xyz"))
    means, spreads = leader.error_lab_m.mean(axis=0), leader.error_lab_m.std(axis=0)
    stats = [f"{1e3 * m:+.2f} ± {1e3 * s:.2f}" for m, s in zip(means, spreads, strict=True)]
    numbers = (_mm(rms(length))[0], _mm(float(length.max()))[0], *stats)
    return table(head, [row(*(cell(n, "number") for n in numbers))])


def _metric_table(summary: Summary) -> str:
    """Every key of the summary that has a meaning of its own, with it."""
    rows = [row(f"<td><code>{key}</code></td>", _value(key, summary), cell(text)) for key, text in MEANINGS.items()]
    return table(("key", "#value", "meaning"), rows)


def _value(key: str, summary: Summary) -> str:
    """A cell with the value as a person reads it."""
    value = getattr(summary, key)
    if key == "command_hash":
        return f'<td class="number"><code>{value[:16]}…</code></td>'
    if isinstance(value, Latency):
        return cell(f"{value.p50:.3g} / {value.p99:.3g} / {value.max:.3g}", "number")
    if key == "age_ms" and summary.age_ms is not None:
        return cell(f"{summary.age_ms.p50:.3g} / {summary.age_ms.p99:.3g}", "number")
    if value is None:
        return cell("–", "number")
    return cell(f"{value:.5g}" if isinstance(value, float) else f"{value}", "number")


def _footer(flight: Flight) -> str:
    """Where the page comes from."""
    versions = f" {escape(flight.run.versions)}." if flight.run.versions else ""
    return (
        "<footer>Made from the flight's log alone; every position is a recorded mocap pose, every time counts from the "
        f"log's first record.{versions}</footer>"
    )


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


ALTITUDE_HEAD = ("vehicle", "#mean altitude, m", "#commanded, m", "#error, mm", "#take-off to, m")


def altitudes(flight: Flight) -> str:
    """One row a vehicle, over the formation phase; empty where it was not flown."""
    colours, rows = style.colours(len(flight.vehicles)), []
    for i, vehicle in enumerate(flight.vehicles):
        mean_m, commanded_m = _measured_m(flight, i), _commanded_m(flight, vehicle.column)
        if mean_m is None:
            continue
        error = "–" if commanded_m is None else f"{1e3 * (mean_m - commanded_m):+.2f}"
        commanded = "–" if commanded_m is None else f"{commanded_m:.4f}"
        configured = "–" if flight.run.lab is None else f"{flight.run.lab.flight.altitude_m:.3f}"
        numbers = (f"{mean_m:.4f}", commanded, error, configured)
        rows.append(row(swatch(vehicle.body, colours[i]), *(cell(number, "number") for number in numbers)))
    return table(ALTITUDE_HEAD, rows) if rows else ""


def _measured_m(flight: Flight, i: int) -> float | None:
    if not len(flight.poses):
        return None
    chosen = in_formation_phase(flight, flight.poses.t_s) & flight.poses.seen[:, i]
    return float(flight.poses.pos_lab_m[chosen, i, 2].mean()) if chosen.any() else None


def _commanded_m(flight: Flight, column: int | None) -> float | None:
    if column is None or not len(flight.reference):
        return None
    chosen = in_formation_phase(flight, flight.reference.t_s)
    return float(reference_lab_m(flight.reference)[chosen, column, 2].mean()) if chosen.any() else None


def downloads(mcap: str | None, report: str | None) -> str:
    """A row of links relative to the page; empty where no file is known. Tables exist once they have been exported."""
    if mcap is None or report is None:
        return ""
    log = Path(mcap)
    beside = Path(os.path.relpath(log.resolve(), Path(report).resolve().parent))
    parts = [f"Data: {_link(beside, f'log ({beside.name})')}"]
    for name, option in (("CSV", "csv"), ("Parquet", "parquet")):
        folder = beside.with_name(f"{beside.stem}-{option}")
        parts.append(f"{_link(folder, name)} after <code>gcs-log export {escape(log.name)} --{option}</code>")
    return f'<p class="downloads">{" · ".join(parts)}</p>'


def _link(to: Path, name: str) -> str:
    return f'<a href="{escape(to.as_posix(), quote=True)}">{escape(name)}</a>'


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


def setup(flight: Flight) -> str:
    """Facts, gains by vehicle kind, profiles, and the whole configuration folded away."""
    metadata = flight.run.metadata
    rows = [row(cell(name), cell(metadata[key])) for key, name in SETUP_FACTS if metadata.get(key)]
    if not rows and flight.run.lab is None:
        return '<p class="missing">Not shown: the log says nothing of what it was flown with.</p>'
    parts = [table(("", ""), rows)] if rows else []
    for key, title in (("gains", "Gains and observers"), ("profiles", "Vehicle profiles")):
        parts += [_values(f"{title}: {name}", values) for name, values in _objects(metadata.get(key, "")).items()]
    if flight.run.lab is not None:
        text = json.dumps(flight.run.lab.model_dump(mode="json"), indent=2)
        parts.append(f"<details><summary>The lab's whole configuration</summary><pre>{escape(text)}</pre></details>")
    return "".join(parts)


def _objects(text: str) -> Mapping[str, Mapping[str, object]]:
    """The object of objects in a log's metadata; none where it is anything else."""
    try:
        found = parse_json(text)
    except ValueError:
        return {}
    return (
        {str(name): values for name, values in found.items() if isinstance(values, dict)}
        if isinstance(found, dict)
        else {}
    )


def _values(title: str, values: Mapping[str, object]) -> str:
    """A folded table of keys and values."""
    rows = [row(f"<td><code>{escape(key)}</code></td>", cell(value)) for key, value in _flat(values)]
    return f"<details><summary>{escape(title)}</summary>{table(('key', 'value'), rows)}</details>"


def _flat(values: Mapping[str, object], prefix: str = "") -> Iterator[tuple[str, str]]:
    for key, value in values.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield prefix + key, f"{value:.6g}" if isinstance(value, float) else str(value)
