"""Drag of the air and tilt of the markers, of the poses alone: how the body tilted against how it moved.

    x'' = (g + z'') (tilt - R(heading) trim) / cos(tilt) - D x'

No derivative is ever taken: as in `analysis.identify.thrust`.
"""

from dataclasses import dataclass

import numpy as np

from analysis.identify.signals import Estimate, Seen, covariance, propagated
from analysis.identify.thrust import BUMP_S, bump, inside, motion
from formation.maths.arrays import Float
from formation.vehicle.body import GRAVITY_M_S2

SPACING_S = 0.1
LEAST = 40
"""Windows."""
TOO_SHORT = "too little uninterrupted free flight"


@dataclass(frozen=True, slots=True)
class Drag:
    """drag_1_s: horizontal, over mass; trim_x, trim_y: tilt of the markers on the body along its x and y, rad."""

    drag_1_s: Estimate
    trim_x: Estimate
    trim_y: Estimate


def fit(saw: Seen) -> Drag | str:
    """Drag and trim of one vehicle, or why they cannot be had from this flight."""
    rows, forces, times_s = list[list[float]](), list[float](), list[float]()
    if len(saw.t_s) < LEAST:
        return TOO_SHORT
    usual = BUMP_S / max(float(np.median(np.diff(saw.t_s))), 1e-9)
    for middle_s in np.arange(saw.t_s[0], saw.t_s[-1], SPACING_S):
        frames = inside(saw.t_s, middle_s)
        since_s = saw.t_s[frames] - middle_s
        if len(since_s) < 0.8 * usual:
            continue  # a window with a gap says nothing
        weight = bump(since_s) / bump(since_s).sum()
        heading, steep = saw.heading_rad[frames], weight / saw.cos_tilt[frames]
        pull_m_s2 = GRAVITY_M_S2 + motion(since_s, saw.height_m[frames])[1]
        cos, sin = pull_m_s2 * (steep @ np.cos(heading)), pull_m_s2 * (steep @ np.sin(heading))
        for axis, trim in enumerate(([-cos, sin], [-sin, -cos])):
            speed, acceleration = motion(since_s, saw.xy_lab_m[frames, axis])
            rows.append([-speed, *trim])
            forces.append(acceleration - pull_m_s2 * float(steep @ saw.tilt[frames, axis]))
            times_s.append(float(middle_s))
    if len(rows) < 2 * LEAST:
        return TOO_SHORT
    regressors, force = np.array(rows), np.array(forces)
    solution: Float = np.linalg.lstsq(regressors, force, rcond=None)[0]
    cov = covariance(regressors, force - regressors @ solution, np.array(times_s))
    return Drag(*propagated(lambda parameters: parameters, solution, cov))
