"""What a flight in the swept fan is judged by: deviation pass by pass, settling, the estimate, and what is sent.

A pass is one sweep of the fan from one end to the other: half its period, in which its jet goes over the drone once.
"""

from dataclasses import dataclass
from math import floor

import numpy as np

from analysis.load import Flight
from analysis.series import nearest
from drone_agent.simulation.disturbance import SweptFan
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.messages import Phase
from sim.scenario import Scenario

PUSHED = 0.05
"""A gust is on while it pushes with more than this share of its peak."""
HOVER_CALM_S = 1.0
SETTLED_M = 0.01
"""A drone nearer than this to its place has settled."""


@dataclass(frozen=True, slots=True)
class GustNumbers:
    """The one follower's numbers, from its true states; NaN where the flight has none.

    mean_dev_m: mean over the whole passes of the largest |deviation in x| in each ("average maximum deviation");
    max_dev_m: the largest of all while the fan sweeps; settle_s: from the end of each push until the deviation stays
    within 1 cm (at most until the next push), mean; z3_error_m_s2: RMS of Z3 against the true push, x; z3_share: that
    over the push's largest; chatter_deg: see `chatter_deg`.
    """

    mean_dev_m: float = np.nan
    max_dev_m: float = np.nan
    settle_s: float = np.nan
    z3_error_m_s2: float = np.nan
    z3_share: float = np.nan
    chatter_deg: float = np.nan


def gust_numbers(flight: Flight, scenario: Scenario) -> GustNumbers:
    """The numbers of a flight of that scenario; all NaN where no fan blew on a follower in formation."""
    fan = scenario.air.fan
    follower = scenario.lab.followers[0]
    spans = flight.spans(Phase.FORMATION)
    if fan is None or not spans or follower.sysid not in flight.truth:
        return GustNumbers()
    truth = flight.truth[follower.sysid]
    end_s = spans[0].end_s
    blowing = (truth.t_s >= fan.start_s) & (truth.t_s <= end_s)
    if not blowing.any():
        return GustNumbers()
    slot = np.array(scenario.leader.pose.pos_lab_m) + np.array(follower.offset_m)
    t_s = truth.t_s[blowing]
    deviation_m = np.abs(truth["pos_lab_m"][blowing, 0] - slot[0])
    push = truth["dist_lab_m_s2"][:, 0]
    estimated = flight.state["dist_lab_m_s2"][:, 1, 0]
    during = (flight.state.t_s >= fan.start_s) & (flight.state.t_s <= end_s)
    error = (estimated - push[nearest(truth.t_s, flight.state.t_s)])[during]
    rms = float(np.sqrt(np.mean(error**2)))
    gain_1_s = scenario.lab.profile_of(follower).attitude_p_1_s
    return GustNumbers(
        mean_of_largest(t_s, deviation_m, sweeps(fan, end_s)),
        float(deviation_m.max()),
        settling(t_s, deviation_m, pushes(np.abs(push[blowing]))),
        rms,
        rms / float(np.abs(push[blowing]).max()),
        _sent_in_calm(flight, spans[0].start_s, fan.start_s, gain_1_s),
    )


def sweeps(fan: SweptFan, end_s: float) -> list[tuple[float, float]]:
    """The whole sweeps of a fan that starts turned away, until end_s: from and to, s."""
    half_s = 0.5 * fan.period_s
    count = floor((end_s - fan.start_s) / half_s)
    return [(fan.start_s + k * half_s, fan.start_s + (k + 1) * half_s) for k in range(count)]


def mean_of_largest(t_s: Float, deviation_m: Float, passes: list[tuple[float, float]]) -> float:
    """Mean over the passes of the largest deviation in each."""
    largest = [float(deviation_m[(t_s >= begin) & (t_s < end)].max()) for begin, end in passes]
    return float(np.mean(largest)) if largest else np.nan


def pushes(push_m_s2: Float) -> list[tuple[int, int, int]]:
    """Each push of the gust: where it begins and ends, and where the next one begins."""
    pushed: Bool = push_m_s2 > PUSHED * push_m_s2.max()
    begins = np.flatnonzero(~pushed[:-1] & pushed[1:]) + 1
    ends = np.flatnonzero(pushed[:-1] & ~pushed[1:]) + 1
    nexts = np.append(begins[1:], len(push_m_s2))
    return [(int(b), int(ends[ends > b][0]), int(n)) for b, n in zip(begins, nexts, strict=True) if np.any(ends > b)]


def settling(t_s: Float, deviation_m: Float, passes: list[tuple[int, int, int]]) -> float:
    """Mean time from the end of a push until the deviation stays within 1 cm, at the latest the next push."""
    times_s = []
    for _, end, after in passes:
        outside = np.flatnonzero(deviation_m[end:after] > SETTLED_M)
        times_s.append(t_s[min(end + outside[-1] + 1, len(t_s) - 1)] - t_s[end] if outside.size else 0.0)
    return float(np.mean(times_s)) if times_s else np.nan


def chatter_deg(q_lab_from_flu: Float, rate_flu_rad_s: Float, attitude_p_1_s: float) -> float:
    """RMS change from tick to tick of all that is sent to turn a drone by, degrees of tilt; q (T, 4), rates (T, 3).

    An autopilot turns at P (target - attitude) + rates, so attitude and rates together ask for a thrust axis of
    up + (rates x up) / P: what counts is how far that moves from each tick to the next. Turns about the thrust axis,
    and rates about it, do not count.
    """
    up = np.broadcast_to(np.array([0.0, 0.0, 1.0]), rate_flu_rad_s.shape)
    asked = frames.rotate(q_lab_from_flu, up + np.cross(rate_flu_rad_s, up) / attitude_p_1_s)
    moved = np.linalg.norm(np.diff(asked, axis=0), axis=-1)
    return float(np.degrees(np.sqrt(np.mean(moved**2)))) if len(moved) else np.nan


def _sent_in_calm(flight: Flight, formation_s: float, gust_s: float, attitude_p_1_s: float) -> float:
    """The chatter in hover, before the gust."""
    target = flight.target
    calm = (target.t_s > formation_s + HOVER_CALM_S) & (target.t_s < gust_s)
    q = target["q_lab_from_flu"][:, 0][calm]
    return chatter_deg(q, target["rate_flu_rad_s"][:, 0][calm], attitude_p_1_s)
