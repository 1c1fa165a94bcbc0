"""From the attitude that the ground sent to the motors: how long each stage takes, by the autopilots' joined logs."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from analysis.identify.signals import sent, tilt_of
from analysis.load import Flight
from analysis.series import Sampled
from formation.maths.arrays import Float

STEP_S = 0.002
LONGEST_S = 0.5
"""No stage takes longer."""
SAMPLES_MOST = 20_000
ALIKE = 0.7
"""Correlation below which one signal is not the other, later."""


@dataclass(frozen=True, slots=True)
class Stage:
    """delay_s: by which the second signal is most like the first; alike: their correlation then."""

    body: str
    name: str
    delay_s: float
    alike: float


def stages(flight: Flight) -> tuple[Stage, ...]:
    """Those of every drone whose log was joined, where the signals are there and moved."""
    return tuple(stage for vehicle in flight.vehicles for stage in _of(flight, vehicle.body, vehicle.sysid))


def _of(flight: Flight, body: str, sysid: int | None) -> Iterator[Stage]:
    of = {name: signal for (owner, name), signal in flight.signals.items() if owner == body}
    targets = sent(flight).get(sysid or 0) if of else None
    tilts = {
        name: Sampled(of[key].t_s, tilt_of(of[key].values))
        for name, key in (("received", "commanded_attitude"), ("flown", "estimated_attitude"))
        if key in of
    }
    if targets is not None:
        tilts["sent"] = Sampled(targets.t_s, tilt_of(targets.q_lab_from_flu))
    pairs = [(a, b, tilts.get(a), tilts.get(b)) for a, b in (("sent", "received"), ("received", "flown"))]
    motors = of.get("motors")
    mean = None if motors is None else Sampled(motors.t_s, motors.values.mean(axis=1, keepdims=True))
    pairs.append(("thrust received", "motors", of.get("commanded_thrust"), mean))
    for first, second, a, b in pairs:
        if a is not None and b is not None and (found := _delay(a, b)) is not None:
            yield Stage(body, f"{first} → {second}", *found)


def _delay(a: Sampled, b: Sampled) -> tuple[float, float] | None:
    """(delay, s, correlation) at which b is most like a, which is held between its samples; None where it never is."""
    inside = np.flatnonzero((b.t_s > a.t_s[0] + LONGEST_S) & (b.t_s < a.t_s[-1] - LONGEST_S))
    inside = inside[:: len(inside) // SAMPLES_MOST + 1]
    if len(inside) < 2:
        return None
    delays_s = np.arange(-LONGEST_S, LONGEST_S, STEP_S)
    at_s, later = b.t_s[inside], _centred(b.values[inside])
    alike = np.array([_correlation(_centred(a.held(at_s - delay_s, np.inf)), later) for delay_s in delays_s])
    k = int(np.argmax(alike))
    if not 0 < k < len(alike) - 1 or not alike[k] > ALIKE:
        return None
    left, best, right = alike[k - 1 : k + 2]
    return float(delays_s[k] + 0.5 * STEP_S * (left - right) / (left - 2.0 * best + right)), float(best)


def _centred(values: Float) -> Float:
    centred: Float = values - values.mean(axis=0)
    return centred


def _correlation(a: Float, b: Float) -> float:
    scale = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.vdot(a, b)) / scale if scale > 0.0 else 0.0
