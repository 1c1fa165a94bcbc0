"""The air that pushes a simulated vehicle: constant wind and the swept fan, as accelerations. No vehicle, no clock.

A pure function of time and place, so that a lockstep run, a real-time run and an analysis see the same gust.
"""

from math import acos, atan2, cos, exp, hypot, pi, sin, sqrt

from formation.model import Model, Positive, Vec3Tuple

STILL: Vec3Tuple = (0.0, 0.0, 0.0)


class SweptFan(Model):
    """A fan on a stand that swings its jet left and right (the paper's gust experiment).

    A free round jet: speed falls as 1/distance along the axis and as a Gaussian of the angle off it
    (Rajaratnam, Turbulent Jets, 1976), and the push goes with the speed squared. `peak_m_s2` is the
    acceleration of a vehicle on the axis at `reference_m` from the fan. Inside the core the jet keeps its speed.
    """

    pos_lab_m: Vec3Tuple = (0.5, 0.0, 0.3)
    heading_rad: float = pi
    sweep_rad: float = 80.0 / 180.0 * pi
    period_s: Positive = 4.0
    phase_s: float = 0.0
    peak_m_s2: float = 3.0
    reference_m: Positive = 0.5
    core_m: Positive = 0.2
    spread_rad: Positive = 20.0 / 180.0 * pi
    start_s: float = 0.0


class Disturbance(Model):
    """Everything that pushes: a steady wind's acceleration in `lab`, and a fan or none."""

    wind_lab_m_s2: Vec3Tuple = STILL
    fan: SweptFan | None = None

    @property
    def is_still(self) -> bool:
        """Whether nothing ever pushes."""
        return self.fan is None and self.wind_lab_m_s2 == STILL


def fan_heading_rad(fan: SweptFan, t_s: float) -> float:
    """Where the fan points at `t_s`, rad about lab z: its crank swings it sinusoidally about `heading_rad`."""
    return fan.heading_rad + fan.sweep_rad * sin(2.0 * pi * (t_s - fan.phase_s) / fan.period_s)


def fan_acceleration(fan: SweptFan, t_s: float, pos_lab_m: Vec3Tuple) -> Vec3Tuple:
    """The fan's push at a place, m/s^2 in `lab`: along the ray from the fan, zero before `start_s`."""
    if t_s < fan.start_s:
        return STILL
    dx, dy, dz = (p - f for p, f in zip(pos_lab_m, fan.pos_lab_m, strict=True))
    distance = max(sqrt(dx * dx + dy * dy + dz * dz), 1e-6)
    swing = atan2(dy, dx) - fan_heading_rad(fan, t_s)
    off_axis = acos(min(max(hypot(dx, dy) / distance * cos(swing), -1.0), 1.0))
    reach = fan.reference_m / max(distance, fan.core_m)
    push = fan.peak_m_s2 * reach * reach * exp(-2.0 * (off_axis / fan.spread_rad) ** 2) / distance
    return push * dx, push * dy, push * dz


def acceleration(disturbance: Disturbance, t_s: float, pos_lab_m: Vec3Tuple) -> Vec3Tuple:
    """What the air does to a vehicle at `pos_lab_m` at time `t_s`: m/s^2 in `lab`."""
    if disturbance.fan is None:
        return disturbance.wind_lab_m_s2
    gust = fan_acceleration(disturbance.fan, t_s, pos_lab_m)
    wind = disturbance.wind_lab_m_s2
    return wind[0] + gust[0], wind[1] + gust[1], wind[2] + gust[2]
