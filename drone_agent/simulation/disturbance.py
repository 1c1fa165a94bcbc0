"""The air that pushes a simulated vehicle: constant wind and the swept fan, as accelerations. No vehicle, no clock.

A pure function of time and place, so that a lockstep run, a real-time run and an analysis see the same gust.
"""

from math import cos, exp, hypot, pi, sin

from formation.model import Model, Positive, Vec3Tuple

STILL: Vec3Tuple = (0.0, 0.0, 0.0)
JET_WIDTH = 0.081  # of a jet's Gaussian, per distance from its nozzle, as Albertson et al. measured it
ROTORS = ((1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0))


class SweptFan(Model):
    """A fan on a stand that swings its jet left and right (the paper's gust experiment).

    Its jet is Albertson's (Albertson, Dai, Jensen, Rouse, Diffusion of submerged jets, Trans. ASCE 115, 1950): a core
    of full speed that thins until it ends after six diameters, around it and beyond a Gaussian that widens with the
    distance. The push goes with the speed squared; `peak_m_s2` is a vehicle's acceleration in the core.
    """

    pos_lab_m: Vec3Tuple = (0.5, 0.0, 0.3)
    heading_rad: float = pi
    sweep_rad: float = 80.0 / 180.0 * pi
    period_s: Positive = 4.0
    phase_s: float = 0.0
    diameter_m: Positive = 0.3
    peak_m_s2: float = 3.0
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


def jet_speed(distance_m: float, aside_m: float, diameter_m: float) -> float:
    """Speed of a round jet over its speed at the fan, at a distance along its axis and a distance off it."""
    if distance_m <= 0.0:
        return 0.0
    width_m = JET_WIDTH * distance_m
    core_m = 0.5 * diameter_m - width_m
    off = max(aside_m - max(core_m, 0.0), 0.0) / width_m
    return min(0.5 * diameter_m / width_m, 1.0) * exp(-0.5 * off * off)


def fan_acceleration(fan: SweptFan, t_s: float, pos_lab_m: Vec3Tuple) -> Vec3Tuple:
    """The fan's push at a place, m/s^2 in `lab`: along its axis, zero before `start_s`."""
    if t_s < fan.start_s:
        return STILL
    heading = fan_heading_rad(fan, t_s)
    c, s = cos(heading), sin(heading)
    dx, dy, dz = (p - f for p, f in zip(pos_lab_m, fan.pos_lab_m, strict=True))
    push = fan.peak_m_s2 * jet_speed(c * dx + s * dy, hypot(c * dy - s * dx, dz), fan.diameter_m) ** 2
    return push * c, push * s, 0.0


def acceleration(disturbance: Disturbance, t_s: float, pos_lab_m: Vec3Tuple, reach_m: float = 0.0) -> Vec3Tuple:
    """What the air does to a vehicle at `pos_lab_m` at time `t_s`: m/s^2 in `lab`.

    reach_m: of its rotors along both horizontal axes; a gust pushes at the four of them.
    """
    wx, wy, wz = disturbance.wind_lab_m_s2
    if disturbance.fan is None:
        return wx, wy, wz
    x, y, z = pos_lab_m
    for ox, oy in ROTORS:
        gx, gy, gz = fan_acceleration(disturbance.fan, t_s, (x + ox * reach_m, y + oy * reach_m, z))
        wx, wy, wz = wx + 0.25 * gx, wy + 0.25 * gy, wz + 0.25 * gz
    return wx, wy, wz
