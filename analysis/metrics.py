"""The numbers a run ends in, computed from its log alone; and requirements such as `formation_rms_m<0.005` on them."""

import hashlib
import json
import operator
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields, replace
from itertools import combinations, pairwise
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from analysis.links import backlogs
from analysis.load import Flight
from analysis.outcome import outcome
from analysis.series import moving_average
from analysis.tracking import Tracking, airborne, track, track_leader
from formation.codes import FlightResult, Outcome
from formation.maths.arrays import Float
from wire.logs.views import AGE_NAME
from wire.mavlink.frames import named_values, setpoints

VIBRATION_WINDOW_S = 1.0
COMMAND = np.dtype([("sysid", "u1"), ("t_boot_ms", "<u4"), ("ignore", "u1"), ("q", "<f8", 4), ("rate", "<f8", 3),
                    ("thrust", "<f8")])  # fmt: skip
BREAK_S = 0.25  # a gap longer than this ends a stretch of flight


@dataclass(frozen=True, slots=True)
class Latency:
    """Of one stage, milliseconds."""

    p50: float
    p99: float
    max: float


@dataclass(frozen=True, slots=True)
class Summary:
    """One run in numbers, SI unless the name says otherwise; None where the log does not have it.

    formation_rms_m, formation_max_m: length of the formation error, all followers, scored frames (analysis.tracking).
    leader_rms_m, leader_max_m: length of a commanded leader's tracking error, reference against mocap, in formation.
    vibration_m: see `vibration`. altitude_rms_m: the error's vertical part. min_separation_m: while airborne.
    mocap_ms: the mocap process had the raw frame -> the ground has the aligned one. latency_ms: from there to the last
    datagram handed to the link. link_behind_ms: age of the drones' telemetry when it was read, all drones.
    command_hash: SHA-256 over every SET_ATTITUDE_TARGET sent, in order. law_failures: how often the lab's own control
    law failed. outcome: see `analysis.outcome`; law failed: which, where the flight itself ended well.
    """

    scenario: str
    seed: int | None
    link: str
    duration_s: float
    followers: int
    formation_rms_m: float | None
    formation_max_m: float | None
    leader_rms_m: float | None
    leader_max_m: float | None
    vibration_m: float | None
    altitude_rms_m: float | None
    min_separation_m: float | None
    frames: int
    late_ticks: int
    law_failures: int
    mocap_ms: Latency | None
    latency_ms: Latency | None
    age_ms: Latency | None
    link_behind_ms: Latency | None
    realtime_factor: float | None
    command_hash: str
    mcap: str | None
    report: str | None
    outcome: Outcome

    def number(self, key: str) -> float | None:
        """The number of one of `KEYS`; None where it is unknown."""
        name, _, part = key.partition(".")
        value = getattr(self, name)
        number: float | None = getattr(value, part) if part and value is not None else value
        return number

    def as_dict(self) -> dict[str, Any]:
        """Every key; the outcome in words."""
        return asdict(self) | {"outcome": str(self.outcome)}

    def to_json(self) -> str:
        """Indented JSON of every key, null where unknown; no NaN."""
        return json.dumps(self.as_dict(), indent=2, allow_nan=False)


def summarise(
    flight: Flight,
    *,
    mcap: Path | None = None,
    report: Path | None = None,
    realtime_factor: float | None = None,
) -> Summary:
    """The summary of a flight; the paths and the host's own speed are not in the log and ride along. A lab's own law
    that failed has no figures: what flew on is not that law."""
    tracking = track(flight)
    if len(flight.law_failures):
        tracking = replace(tracking, scored=np.zeros_like(tracking.scored))
    error_m = np.linalg.norm(tracking.error_lead_m, axis=-1)[tracking.scored]
    leader_m = np.linalg.norm(track_leader(flight).error_lab_m, axis=-1)
    live = not flight.run.lockstep
    behind_ms = [np.zeros(0), *(link.behind_ms for link in backlogs(flight))] if live else [np.zeros(0)]
    known = flight.poses.mocap_s > 0.0  # of a mocap process that says so
    mocap_ms = 1e3 * (flight.poses.received_s - flight.poses.mocap_s)[known & live]
    return Summary(
        scenario=flight.run.scenario,
        seed=flight.run.seed,
        link=flight.run.link,
        duration_s=flight.duration_s,
        followers=len(flight.followers),
        formation_rms_m=rms(error_m),
        formation_max_m=float(error_m.max()) if error_m.size else None,
        leader_rms_m=rms(leader_m),
        leader_max_m=float(leader_m.max()) if leader_m.size else None,
        vibration_m=vibration(tracking),
        altitude_rms_m=rms(tracking.error_lead_m[..., 2][tracking.scored]),
        min_separation_m=min_separation(flight),
        frames=len(flight.poses),
        late_ticks=int(flight.timing["late"].sum()),
        law_failures=len(flight.law_failures),
        mocap_ms=_percentiles(mocap_ms),
        latency_ms=_percentiles(1e3 * flight.timing["latency_s"]),
        age_ms=_percentiles(ages_ms(flight)) if live else None,
        link_behind_ms=_percentiles(np.concatenate(behind_ms)),
        realtime_factor=realtime_factor,
        command_hash=command_hash(flight),
        mcap=None if mcap is None else str(mcap),
        report=None if report is None else str(report),
        outcome=_with_laws(outcome(flight), flight),
    )


def rms(values: Float) -> float | None:
    """Root mean square; None of nothing."""
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else None


def vibration(tracking: Tracking) -> float | None:
    """Mean half peak-to-peak (m) of the deviation about its 1 s moving average, over followers, x and y.

    The deviation is the formation error in the leader's frame less its centred moving average; half of its
    peak-to-peak is taken in each full 1 s of scored flight and averaged. The paper's "vibration amplitude".
    """
    each = [vibration_of(tracking, follower) for follower in range(tracking.scored.shape[1])]
    known = [amplitude for amplitude in each if amplitude is not None]
    return float(np.mean(known)) if known else None


def vibration_of(tracking: Tracking, follower: int) -> float | None:
    """The vibration of one follower; None of less than 2 s of scored flight."""
    scored = tracking.scored[:, follower]
    halves = _half_peak_to_peaks(tracking.t_s[scored], tracking.error_lead_m[scored, follower, :2])
    return float(np.mean(halves)) if halves else None


def _half_peak_to_peaks(t_s: Float, error_m: Float) -> list[Float]:
    """Half peak-to-peak (2,) of each second of one follower's error (T, 2); none of too short a flight.

    Unbroken stretches are taken one by one, and only seconds for which the moving average has its full window.
    """
    halves = []
    for stretch in np.split(np.arange(len(t_s)), np.flatnonzero(np.diff(t_s) > BREAK_S) + 1):
        t, error = t_s[stretch], error_m[stretch]
        seconds = int((t[-1] - t[0]) / VIBRATION_WINDOW_S) - 1 if len(t) > 1 else 0
        if seconds < 1:
            continue
        deviation = error - moving_average(t, error, VIBRATION_WINDOW_S)
        edges = np.searchsorted(t, t[0] + (0.5 + np.arange(seconds + 1)) * VIBRATION_WINDOW_S)
        halves += [0.5 * np.ptp(deviation[i:j], axis=0) for i, j in pairwise(edges)]
    return halves


def min_separation(flight: Flight) -> float | None:
    """Least distance (m) between two vehicles seen in the same frame while airborne; None of fewer than two."""
    poses = flight.poses
    flying = airborne(flight, poses.t_s)
    distances = [
        np.linalg.norm(poses.pos_lab_m[:, i] - poses.pos_lab_m[:, j], axis=-1)[
            flying & poses.seen[:, i] & poses.seen[:, j]
        ]
        for i, j in combinations(range(len(flight.vehicles)), 2)
    ]
    nearest = [float(d.min()) for d in distances if d.size]
    return min(nearest) if nearest else None


def _percentiles(ms: Float) -> Latency | None:
    if not ms.size:
        return None
    p50, p99 = np.percentile(ms, [50.0, 99.0])
    return Latency(float(p50), float(p99), float(ms.max()))


def ages_ms(flight: Flight) -> Float:
    """Every reported setpoint age, all drones."""
    return named_values(flight.up.frames, AGE_NAME)[1]


def command_hash(flight: Flight) -> str:
    """SHA-256 of every SET_ATTITUDE_TARGET sent, in order: drone, stamp, mask, attitude, rates, thrust."""
    sent = setpoints(flight.down.frames, flight.down.sysid)
    rows = np.zeros(len(sent.datagram), COMMAND)
    rows["sysid"], rows["t_boot_ms"], rows["ignore"] = flight.down.sysid[sent.datagram], sent.t_boot_ms, sent.ignore
    rows["q"], rows["rate"], rows["thrust"] = sent.q_lab_from_flu, sent.rate_flu_rad_s, sent.thrust_norm
    return hashlib.sha256(rows.tobytes()).hexdigest()


def _with_laws(ended: Outcome, flight: Flight) -> Outcome:
    """The outcome; of a flight that ended well, that the law which it was to show did not fly to its end."""
    failures = flight.law_failures.messages
    return Outcome(FlightResult.LAW_FAILED, failures[0].text) if failures and ended.is_good else ended


RELATIONS: Mapping[str, Callable[[float, float], bool]] = MappingProxyType(
    {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt}
)
WORDED = ("scenario", "link", "command_hash", "mcap", "report", "outcome")
USAGE = "a requirement is KEY<NUMBER, with <, <=, > or >=, such as formation_rms_m<0.005"


@dataclass(frozen=True, slots=True)
class Requirement:
    """One number of `analysis.metrics.Summary` and its bound, SI as there; `latency_ms.p99` is one of a group."""

    key: str
    relation: str
    bound: float

    @property
    def text(self) -> str:
        """As `parse` reads it."""
        return f"{self.key}{self.relation}{self.bound:g}"

    def unmet(self, summary: Summary) -> str | None:
        """Why the flight does not reach it; None where it does. A number that the log does not have is not reached."""
        value = summary.number(self.key)
        if value is None:
            return f"{self.text} is required, and not known of this flight"
        reached = RELATIONS[self.relation](value, self.bound)
        return None if reached else f"{self.text} is required, it is {value:.4g}"


def parse_requirement(text: str) -> Requirement:
    """The requirement in such words; ValueError says what is not understood, and which keys there are."""
    found = re.fullmatch(r"\s*([a-z0-9_.]+)\s*(<=|>=|<|>)\s*(\S+)\s*", text)
    if found is None:
        raise ValueError(f"{text!r} is not understood: {USAGE}")
    key, relation, number = found.groups()
    if key not in KEYS:
        raise ValueError(f"{key!r} is no number of a flight; known: {', '.join(KEYS)}")
    try:
        return Requirement(key, relation, float(number))
    except ValueError as error:
        raise ValueError(f"{number!r} is not a number: {USAGE}") from error


def unmet(requirements: Iterable[Requirement], summary: Summary) -> tuple[str, ...]:
    """Of each that the flight does not reach, why."""
    return tuple(why for requirement in requirements if (why := requirement.unmet(summary)) is not None)


_PARTS = tuple(part.name for part in fields(Latency))
KEYS = tuple(
    f"{field.name}.{part}" if part else field.name
    for field in fields(Summary)
    if field.name not in WORDED
    for part in (_PARTS if field.name.endswith("_ms") else ("",))
)
"""Every number that can be required."""
