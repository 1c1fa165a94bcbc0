"""`gcs-log whatif`: a recorded flight beside the same flight under another law, and how far that is to be trusted.

It is first flown again under its own law and must come back. Then the other law meets the recorded leader, delays,
frames and disturbance. Trust ends where the other law leaves what the recorded flight excited: the disturbance is
known at the recorded places and up to a frequency, and the vehicle's answer for the commands that it was given.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np

from analysis.compare import Side, configuration
from analysis.identify.signals import tilt_of
from analysis.load import Flight
from analysis.metrics import summarise
from analysis.tracking import in_formation_phase, track
from formation.codes import FlightResult
from formation.config import LabConfig, VehicleBody
from formation.maths.arrays import Float
from formation.vehicle.profile import VehicleProfile
from sim.research.gust import chatter_deg
from sim.research.host import GUST_NS
from sim.research.recorded import Recorded, reconstruct
from sim.research.reflight import Change, refly
from sim.world import T0_NS

COMES_BACK = 0.1
"""The RMS of the recorded flight, flown again under its own law, may differ by this share."""
OUTSIDE_M, SPEED_S = 0.01, 0.1
EXCITED_SHARE, EXCITED_TWICE = 0.05, 2.0
"""Frequencies above those with all but this share of the commands' power are not excited; a law with more than so many
times that share above them leaves them."""


@dataclass(frozen=True, slots=True)
class Commands:
    """What one follower was commanded and did in formation.

    tilt_deg, thrust_norm: largest; thrust_low_norm: least; speed_m_s: largest; above_share: of the tilt commands' power
    above excited_hz; chatter_deg: sim.research.gust.
    """

    tilt_deg: float
    thrust_norm: float
    thrust_low_norm: float
    speed_m_s: float
    above_share: float
    chatter_deg: float


@dataclass(frozen=True, slots=True)
class Trust:
    """How far one follower's prediction is to be trusted.

    known_hz (3): up to there its disturbance is known, along x, y, z; dist_rms_m_s2 (3): that disturbance. excited_hz:
    below it lies the power of the recorded tilt commands, by all but EXCITED_SHARE. away_m: farthest from the recorded
    path. leaves: where the other law leaves the excited region, in words.
    """

    body: str
    identified: bool
    known_hz: tuple[float, ...]
    dist_rms_m_s2: tuple[float, ...]
    excited_hz: float
    away_m: float
    recorded: Commands
    other: Commands
    leaves: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class WhatIf:
    """The recorded flight, the same flown again under its own law, and the other.

    name: of the log; figures: their numbers, in that order (`figures`); parts: what the first was taken apart into.
    """

    name: str
    recorded: Side
    again: Side
    other: Side
    figures: tuple[Mapping[str, float | None], ...]
    result: FlightResult
    trust: tuple[Trust, ...]
    parts: Recorded

    @property
    def back_share(self) -> float:
        """How far the RMS of the flight flown again is from the recorded one, as a share of it."""
        was, now = self.recorded.summary.formation_rms_m, self.again.summary.formation_rms_m
        return np.inf if not was or now is None else now / was - 1.0

    @property
    def comes_back(self) -> bool:
        """Whether the recorded flight came back under its own law."""
        return abs(self.back_share) <= COMES_BACK

    @property
    def sides(self) -> tuple[Side, Side, Side]:
        """The three, in the order of the tables."""
        return self.recorded, self.again, self.other

    def to_json(self) -> str:
        """Numbers of the three, trust, and what was not the same in the configuration."""
        values = {
            "comes_back": self.comes_back,
            "back_share": self.back_share if np.isfinite(self.back_share) else None,
            "outcome": self.result,
            "cut": self.parts.cut,
            **dict(zip(("recorded", "again", "other"), self.figures, strict=True)),
            "trust": [asdict(trust) for trust in self.trust],
            "configuration": configuration(self.again, self.other),
        }
        return json.dumps(values, indent=2, allow_nan=False)


def what_if(flight: Flight, change: Change, name: str, progress: Callable[[str], None] = lambda _text: None) -> WhatIf:
    """Ask a flight; RecordedError where its log does not say enough, ValueError where the law cannot be made.

    progress: called with how far it is.
    """
    progress("finding what acted on the drones")
    recorded = reconstruct(flight)
    _, again = refly(recorded, Change(), lambda share: progress(f"its own law, {share:.0%} flown"))
    result, other = refly(recorded, change, lambda share: progress(f"{change.text}, {share:.0%} flown"))
    if change.without is not None:
        flight, again, recorded = (_without(flight, change.without), _without(again, change.without),
                                   recorded.without(change.without))  # fmt: skip
    end_s = min((recorded.end_ns - T0_NS) * 1e-9, other.duration_s)
    titles = "recorded", "again", change.text
    was, back, would_be = (
        _side(title, _until(each, end_s)) for title, each in zip(titles, (flight, again, other), strict=True)
    )
    if would_be.summary.law_failures:
        result = FlightResult.LAW_FAILED
    trust = tuple(_trust(recorded, was.flight, would_be.flight, k) for k in range(1, len(recorded.lab.vehicles)))
    return WhatIf(name, was, back, would_be, tuple(map(figures, (was, back, would_be))), result, trust, recorded)


def figures(side: Side) -> Mapping[str, float | None]:
    """The numbers shown of one flight, SI; settle_s: how long an excursion beyond 1 cm lasts, mean."""
    summary, tracking = side.summary, track(side.flight)
    outside = [
        _excursions_s(tracking.t_s[scored], np.linalg.norm(tracking.error_lead_m[scored, k], axis=-1))
        for k, scored in enumerate(tracking.scored.T)
    ]
    lasted = np.concatenate([np.zeros(0), *outside])
    return {
        "formation_rms_m": summary.formation_rms_m,
        "formation_max_m": summary.formation_max_m,
        "settle_s": None if summary.law_failures else float(lasted.mean()) if lasted.size else 0.0,
        "vibration_m": summary.vibration_m,
        "altitude_rms_m": summary.altitude_rms_m,
        "min_separation_m": summary.min_separation_m,
    }


def _excursions_s(t_s: Float, error_m: Float) -> Float:
    """How long each excursion beyond OUTSIDE_M lasted."""
    outside = np.concatenate([[False], error_m > OUTSIDE_M, [False]])
    begins, ends = np.flatnonzero(~outside[:-1] & outside[1:]), np.flatnonzero(outside[:-1] & ~outside[1:])
    lasted: Float = t_s[np.minimum(ends, len(t_s) - 1)] - t_s[begins]
    return lasted


def _side(name: str, flight: Flight) -> Side:
    return Side(name, flight, summarise(flight))


def _until(flight: Flight, end_s: float) -> Flight:
    """The same flight, whose phases end there."""
    spans = [replace(span, end_s=min(span.end_s, end_s)) for span in flight.phases if span.start_s <= end_s]
    return replace(flight, phases=tuple(spans))


def _without(flight: Flight, body: str) -> Flight:
    """The same flight, as if that follower had not been there."""
    stays = [vehicle.body != body for vehicle in flight.vehicles]
    arrays = ("pos_lab_m", "q_lab_from_flu", "seen", "rejected")
    poses = replace(flight.poses, **{name: getattr(flight.poses, name)[:, stays] for name in arrays})
    return replace(flight, poses=poses, vehicles=tuple(v for v in flight.vehicles if v.body != body))


def _trust(recorded: Recorded, flown: Flight, other: Flight, k: int) -> Trust:
    """Of one follower, by its place among the lab's vehicles."""
    body, drone = recorded.lab.vehicles[k].body, recorded.lab.commanded.index(k)
    excited_hz = _excited_hz(*_tilts(flown, body))
    was, would_be = (_commands(one, body, recorded.lab.profile_of(recorded.lab.vehicles[k]), excited_hz)
                     for one in (flown, other))  # fmt: skip
    away_m = _away_m(flown, other, body)
    return Trust(
        body=body,
        identified=recorded.identified[drone],
        known_hz=tuple(recorded.known_hz[drone].tolist()),
        dist_rms_m_s2=tuple(np.sqrt(np.mean(np.square(disturbance(recorded, drone)), axis=0)).tolist()),
        excited_hz=excited_hz,
        away_m=away_m,
        recorded=was,
        other=would_be,
        leaves=tuple(_leaves(was, would_be, excited_hz, away_m, recorded.lab.vehicles[k], recorded.lab)),
    )


def disturbance(recorded: Recorded, drone: int) -> Float:
    """What acted on a drone while it is flown again, (K, 3), m/s^2 every GUST_S."""
    begin, end = ((t_ns - T0_NS) // GUST_NS for t_ns in (recorded.begin_ns, recorded.end_ns))
    return recorded.wind[begin:end, drone]


def _tilts(flight: Flight, body: str) -> tuple[Float, Float]:
    """Times (T,) in formation and the tilt commanded then, (T, 2)."""
    formed = in_formation_phase(flight, flight.target.t_s)
    return flight.target.t_s[formed], tilt_of(_of(flight, "q_lab_from_flu", body)[formed])


def _of(flight: Flight, field: str, body: str) -> Float:
    """One drone's column of the targets."""
    column = next(vehicle.column for vehicle in flight.vehicles if vehicle.body == body)
    values: Float = flight.target[field][:, column]
    return values


def _excited_hz(t_s: Float, tilt: Float) -> float:
    """Below it lies all but EXCITED_SHARE of the power of the commanded tilt."""
    hz, power = spectrum(t_s, tilt)
    within = np.cumsum(power) >= (1.0 - EXCITED_SHARE) * power.sum()
    return float(hz[np.argmax(within)])


def spectrum(t_s: Float, values: Float) -> tuple[Float, Float]:
    """Frequencies and the power at each, of all columns (T, d) together, without their means."""
    even_s = np.linspace(t_s[0], t_s[-1], len(t_s))
    even = np.stack([np.interp(even_s, t_s, column) for column in values.T], axis=1)
    window = np.hanning(len(even))[:, None]
    power = np.square(np.abs(np.fft.rfft(window * (even - even.mean(axis=0)), axis=0))).sum(axis=1)
    hz = np.asarray(np.fft.rfftfreq(len(even), float(even_s[1] - even_s[0])), np.float64)
    return hz, np.asarray(power, np.float64)


def _commands(flight: Flight, body: str, profile: VehicleProfile, excited_hz: float) -> Commands:
    t_s, tilt = _tilts(flight, body)
    formed = in_formation_phase(flight, flight.target.t_s)
    hz, power = spectrum(t_s, tilt)
    thrust_norm = _of(flight, "thrust_norm", body)[formed]
    q, rate = (_of(flight, name, body)[formed] for name in ("q_lab_from_flu", "rate_flu_rad_s"))
    when_s, path_m = _path(flight, body)
    stride = max(int(SPEED_S / float(np.median(np.diff(when_s)))), 1)
    speed_m_s = np.linalg.norm(path_m[stride:] - path_m[:-stride], axis=-1) / (when_s[stride:] - when_s[:-stride])
    return Commands(
        tilt_deg=float(np.degrees(np.arcsin(np.clip(np.linalg.norm(tilt, axis=-1).max(), 0.0, 1.0)))),
        thrust_norm=float(thrust_norm.max()),
        thrust_low_norm=float(thrust_norm.min()),
        speed_m_s=float(speed_m_s.max()),
        above_share=float(power[hz > excited_hz].sum() / power.sum()),
        chatter_deg=chatter_deg(q, rate, profile.attitude_p_1_s),
    )


def _path(flight: Flight, body: str) -> tuple[Float, Float]:
    """When a body was seen in formation, (T,), and where, (T, 3)."""
    poses = flight.poses
    index = next(i for i, vehicle in enumerate(flight.vehicles) if vehicle.body == body)
    shown = poses.seen[:, index] & in_formation_phase(flight, poses.t_s)
    return poses.t_s[shown], poses.pos_lab_m[shown, index]


def _away_m(flown: Flight, other: Flight, body: str) -> float:
    """How far the other flight was from the recorded one at the same time, at most."""
    (t_s, path_m), (other_s, other_m) = _path(flown, body), _path(other, body)
    there = np.stack([np.interp(other_s, t_s, axis) for axis in path_m.T], axis=1)
    return float(np.linalg.norm(other_m - there, axis=-1).max())


def _leaves(
    was: Commands, would_be: Commands, excited_hz: float, away_m: float, vehicle: VehicleBody, lab: LabConfig
) -> Iterator[str]:
    """Where the other law leaves what the recorded flight excited."""
    width_m = lab.profile_of(vehicle).wheelbase_m
    if would_be.above_share > EXCITED_TWICE * EXCITED_SHARE:
        yield (f"{100 * would_be.above_share:.0f} % of its tilt commands' power is above {excited_hz:.1f} Hz, recorded "
               "are 5 %: how the vehicle answers there is not known")  # fmt: skip
    if would_be.tilt_deg > 1.0 + was.tilt_deg:
        yield f"it tilts up to {would_be.tilt_deg:.1f} degrees, the recorded flight up to {was.tilt_deg:.1f}"
    if would_be.thrust_norm > 1.1 * was.thrust_norm or would_be.thrust_low_norm < 0.9 * was.thrust_low_norm:
        yield (f"its thrust goes from {would_be.thrust_low_norm:.2f} to {would_be.thrust_norm:.2f}, the recorded from "
               f"{was.thrust_low_norm:.2f} to {was.thrust_norm:.2f}")  # fmt: skip
    if away_m > width_m:
        yield f"it comes {1e3 * away_m:.0f} mm off the recorded path: a wind that depends on the place may be another"
