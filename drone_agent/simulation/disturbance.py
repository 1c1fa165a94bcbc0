"""The air that pushes a simulated vehicle: constant wind and the swept fan, as accelerations. No vehicle, no clock.

A pure function of time and place, so that a lockstep run, a real-time run and an analysis see the same gust.
"""

from dataclasses import dataclass
from functools import cached_property
from math import cos, exp, hypot, pi, sin

import numpy as np

from formation.maths.arrays import Float, Vec3
from formation.maths.kernel import kernel
from formation.maths.records import Rows, rows
from formation.model import Model, Positive, Vec3Tuple
from formation.vehicle.downwash import JET_WIDTH

STILL: Vec3Tuple = (0.0, 0.0, 0.0)


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


@dataclass(frozen=True, slots=True)
class Air:
    """A disturbance as kernels read it; a record. Without a fan, peak_m_s2 is 0."""

    wind_lab_m_s2: Vec3
    fan_pos_lab_m: Vec3
    heading_rad: float
    sweep_rad: float
    period_s: float
    phase_s: float
    diameter_m: float
    peak_m_s2: float
    start_s: float


class Disturbance(Model):
    """Everything that pushes: a steady wind's acceleration in `lab`, and a fan or none."""

    wind_lab_m_s2: Vec3Tuple = STILL
    fan: SweptFan | None = None

    @cached_property
    def air(self) -> Rows[Air]:
        """The same, one record."""
        fan = self.fan or SweptFan(peak_m_s2=0.0)
        shape = (fan.heading_rad, fan.sweep_rad, fan.period_s, fan.phase_s, fan.diameter_m, fan.peak_m_s2, fan.start_s)
        return rows(Air, [Air(np.array(self.wind_lab_m_s2), np.array(fan.pos_lab_m), *shape)])


@kernel
def fan_heading_rad(air: Rows[Air], t_s: float) -> float:
    """Where the fan points at `t_s`, rad about lab z: its crank swings it sinusoidally about `heading_rad`."""
    fan = air[0]
    return fan.heading_rad + fan.sweep_rad * sin(2.0 * pi * (t_s - fan.phase_s) / fan.period_s)


@kernel
def jet_speed(distance_m: float, aside_m: float, diameter_m: float) -> float:
    """Speed of a round jet over its speed at the fan, at a distance along its axis and a distance off it."""
    if distance_m <= 0.0:
        return 0.0
    width_m = JET_WIDTH * distance_m
    core_m = 0.5 * diameter_m - width_m
    off = max(aside_m - max(core_m, 0.0), 0.0) / width_m
    return min(0.5 * diameter_m / width_m, 1.0) * exp(-0.5 * off * off)


@kernel
def push_into(air: Rows[Air], t_s: float, pos_lab_m: Float, reach_m: float, push: Float) -> None:
    """What the air does to a vehicle at pos_lab_m (3) at t_s, into push (3): m/s^2 in `lab`.

    reach_m: of its rotors along both horizontal axes; the fan, which blows from its start on, pushes at the four of
    them, along its axis.
    """
    fan = air[0]
    for axis in range(3):
        push[axis] = fan.wind_lab_m_s2[axis]
    if fan.peak_m_s2 == 0.0 or t_s < fan.start_s:
        return
    heading = fan_heading_rad(air, t_s)
    c, s = cos(heading), sin(heading)
    dz = pos_lab_m[2] - fan.fan_pos_lab_m[2]
    for rotor in range(4):
        dx = pos_lab_m[0] - fan.fan_pos_lab_m[0] + (reach_m if rotor < 2 else -reach_m)
        dy = pos_lab_m[1] - fan.fan_pos_lab_m[1] + (reach_m if rotor % 2 == 0 else -reach_m)
        speed = jet_speed(c * dx + s * dy, hypot(c * dy - s * dx, dz), fan.diameter_m)
        push[0] += 0.25 * fan.peak_m_s2 * speed * speed * c
        push[1] += 0.25 * fan.peak_m_s2 * speed * speed * s


def acceleration(disturbance: Disturbance, t_s: float, pos_lab_m: Vec3Tuple, reach_m: float = 0.0) -> Vec3:
    """`push_into` of one place: m/s^2 in `lab` (3)."""
    push = np.empty(3)
    push_into(disturbance.air, t_s, np.array(pos_lab_m), reach_m, push)
    return push
