"""Pushes that a vehicle was given, found in its poses alone, and how it met them beside what was possible.

Thrust is along the body's axis, and its height is what holds the vehicle up or lifts it: so attitude and vertical
motion give its own acceleration sideways. What is left of its motion pushes it, and a smoother finds that from both
sides in time (formation.estimation.smoother). The observer of the flight would not do: it lags, so a push would seem
to begin late, and its bound would be more than was flown.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from formation.estimation.smoother import smooth
from formation.maths import frames
from formation.maths.arrays import Bool, Float, Quats, Vec3s
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.bound import (
    STEP_S,
    attitude_loop,
    least_deviation_by_attitude_m,
    least_deviation_m,
    turning,
)
from formation.vehicle.profile import VehicleProfile

CALM_S = 1.0
"""A push is what differs from the median of so long before it; it is judged until so long after it."""
BEGUN = 0.01
"""Of its peak: the push has begun, and is not over."""
SETTLED_M = 0.01
"""A drone nearer than this to its place has settled; a push that the best law can hold within it is none."""
DIFFERENCES = 4
DIFFERENCED = 70.0
"""How much larger the variance of noise is in the fourth differences: 1 + 16 + 36 + 16 + 1."""
MAD_TO_DEVIATION = 1.4826  # of a normal distribution
NOISE_LEAST_M = 1e-5


@dataclass(frozen=True, slots=True)
class Push:
    """A sideways push of a vehicle from begin_s to end_s, and the largest deviations along it, m.

    by_motors_m, by_attitude_m: what is possible at the least (formation.vehicle.bound), the second within limit_rad of
    tilt; flown_m, tilt_rad: what was flown, and how far it tilted for that: body rates may take it past the limit.
    """

    begin_s: float
    end_s: float
    peak_m_s2: float
    by_motors_m: float
    by_attitude_m: float
    flown_m: float
    limit_rad: float
    tilt_rad: float

    @property
    def text(self) -> str:
        """`about 42 mm possible within 34° of tilt, 73 mm flown with 30°`: noise hides when a push began."""
        limit, tilt = np.degrees((self.limit_rad, self.tilt_rad))
        possible_mm, flown_mm = 1e3 * self.by_attitude_m, 1e3 * self.flown_m
        return (
            f"about {possible_mm:.0f} mm possible within {limit:.0f}° of tilt, {flown_mm:.0f} mm flown with {tilt:.0f}°"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """A stretch of one vehicle's flight: the poses (T) that were seen, at rising times, and its error in `lab`."""

    t_s: Float
    pos_lab_m: Vec3s
    q_lab_from_flu: Quats
    error_lab_m: Vec3s


def pushes(flown: Flown, profile: VehicleProfile, pose_delay_s: float, tilt_rad: float) -> list[Push]:
    """Every push that peaks after the first CALM_S and before the last, in order of time; none where it turned over.

    pose_delay_s: of the cameras, capture to receipt by the ground; tilt_rad: the lab's limit.
    """
    up = frames.rotate(flown.q_lab_from_flu, np.broadcast_to(np.array([0.0, 0.0, 1.0]), (len(flown.t_s), 3)))
    if len(up) <= DIFFERENCES or flown.t_s[-1] - flown.t_s[0] <= 2.0 * CALM_S or up[:, 2].min() <= 0.0:
        return []
    loop = attitude_loop(profile, pose_delay_s, tilt_rad)
    count, span = round(CALM_S / float(np.median(np.diff(flown.t_s)))), round(CALM_S / STEP_S)
    disturbance, own = _disturbance(flown, up, profile.drag_1_s[:2])
    calm = np.median(sliding_window_view(disturbance, count, axis=0)[: -count - 1], axis=-1)
    height = np.linalg.norm(disturbance[count : count + len(calm)] - calm, axis=1)
    fine_s = np.arange(flown.t_s[0], flown.t_s[-1], STEP_S)
    found = []
    while len(height) and least_deviation_by_attitude_m(np.full(span, height.max()), loop) > SETTLED_M:
        peak = int(np.argmax(height))
        along = (disturbance[count + peak] - calm[peak]) / height[peak]
        push = np.interp(fine_s, flown.t_s, (disturbance - calm[peak]) @ along)
        begin, end = _limits(push > BEGUN * height[peak], int((flown.t_s[count + peak] - flown.t_s[0]) / STEP_S))
        begin_s, end_s = fine_s[[begin, end]].tolist()
        # Who accelerates along the push at its beginning may change so much more.
        along_m_s2 = float(np.interp(begin_s, flown.t_s, own @ along))
        by_attitude_m = least_deviation_by_attitude_m(
            push[begin : end + span], replace(loop, most_m_s2=loop.most_m_s2 + along_m_s2)
        )
        if by_attitude_m > SETTLED_M:
            by_motors_m = least_deviation_m(
                push[begin : end + span], turning(profile), pose_delay_s + profile.command_delay_s
            )
            met = (flown.t_s >= begin_s) & (flown.t_s <= end_s + CALM_S)
            largest_m = float(np.abs(flown.error_lab_m[met, :2] @ along).max())
            most_rad = float(np.arccos(up[met, 2].min()))
            found.append(
                Push(begin_s, end_s, float(height[peak]), by_motors_m, by_attitude_m, largest_m, tilt_rad, most_rad)
            )
        inside = (flown.t_s >= begin_s) & (flown.t_s <= end_s)
        inside[count + peak] = True
        height[inside[count : count + len(calm)]] = 0.0
    return sorted(found, key=lambda each: each.begin_s)


def _disturbance(flown: Flown, up: Vec3s, drag_1_s: Float) -> tuple[Float, Float]:
    """What pushes the vehicle sideways beside its drag, and how its thrust moves it, (T, 2) each, m/s^2 in `lab`."""
    t_s, pos_m = flown.t_s, flown.pos_lab_m.T
    noise = np.median(np.abs(np.diff(pos_m, DIFFERENCES)), axis=1) * MAD_TO_DEVIATION / np.sqrt(DIFFERENCED)
    noise_m, seen = np.maximum(noise, NOISE_LEAST_M), np.ones_like(pos_m, np.bool_)
    lifted = smooth(t_s, pos_m[2:], seen[2:], np.zeros((1, len(t_s) - 1)), noise_m[2:]).dist_m_s2
    thrust = (GRAVITY_M_S2 + lifted) * up.T[:2] / up[:, 2]
    own = 0.5 * (thrust[:, 1:] + thrust[:, :-1])
    found = smooth(t_s, pos_m[:2], seen[:2], own, noise_m[:2])
    return (found.dist_m_s2 + drag_1_s[:, None] * found.vel_m_s).T, thrust.T


def _limits(pushed: Bool, peak: int) -> tuple[int, int]:
    """From where to where a push goes on about its peak."""
    before, after = np.flatnonzero(~pushed[:peak]), np.flatnonzero(~pushed[peak:])
    return int(before[-1]) if len(before) else 0, peak + int(after[0]) if len(after) else len(pushed) - 1
