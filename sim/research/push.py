"""A steady push: how it is made, how hard a vehicle can bear it, and what a flight in it is judged by.

It begins at once and stays, as a wall of wind that is opened. Its strength is a share of what the tilt limit holds
against.
"""

from dataclasses import dataclass
from math import tan

import numpy as np

from analysis.load import Flight
from drone_agent.simulation.disturbance import Disturbance, SweptFan
from formation.codes import GOOD_RESULTS
from formation.config import LabConfig
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.messages import Phase
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile

BEGIN_S, LATE_S = 10.0, 3.0
FORMATION_S = 14.0
WALL = SweptFan(pos_lab_m=(3.0, 0.0, 0.3), sweep_rad=0.0, diameter_m=20.0, start_s=BEGIN_S)
"""A fan so wide that it pushes alike wherever the drone goes."""
SETTLED_DEG, CALM_SHARE = 1.0, 1.5
"""Settled: within SETTLED_DEG of the tilt that holds against the push; calm: it then swings by no more than so many
times what the cameras' noise shook it by before."""
SHARE_MOST, STRAYED_M = 0.9, 0.5
"""A push is at most so much of what the tilt limit holds against, and one that must carry the vehicle so far at most:
half of what the ground lands it at."""


@dataclass(frozen=True, slots=True)
class Settling:
    """How a push was met; NaN where none was flown, or the formation ended before.

    swing_deg: largest angle of the thrust axis off its mean in the last LATE_S, hover_deg: in as long before the push;
    settle_s: from the push until it stays within SETTLED_DEG of that mean; deviation_m: largest of the position.
    """

    outcome: str
    swing_deg: float = np.nan
    hover_deg: float = np.nan
    settle_s: float = np.nan
    deviation_m: float = np.nan

    @property
    def at_rest(self) -> bool:
        """Whether it ended well, and did not swing at last."""
        return self.outcome in GOOD_RESULTS and self.swing_deg <= CALM_SHARE * self.hover_deg


def push_of(lab: LabConfig, share: float) -> dict[str, object]:
    """What changes of a hovering scenario of that lab in a push of that share."""
    fan = WALL.model_copy(update={"peak_m_s2": share * GRAVITY_M_S2 * tan(lab.limits.tilt_rad)})
    return {"air": Disturbance(fan=fan), "formation_s": FORMATION_S}


def share_most(vehicle: VehicleProfile, tilt_rad: float) -> float:
    """The hardest push to fly in: at most SHARE_MOST, and one that carries this vehicle STRAYED_M away.

    For its dead time and lags it goes with the push p; then the limit a holds against it: p t^2/2 + (p t)^2/2 (a - p).
    """
    most_m_s2 = GRAVITY_M_S2 * tan(tilt_rad)
    unanswered_s = vehicle.command_delay_s + 1.0 / vehicle.attitude_p_1_s + 1.0 / vehicle.rate_p_1_s
    shares = np.linspace(0.01, 0.99, 99)
    push_m_s2, left_m_s2 = shares * most_m_s2, (1.0 - shares) * most_m_s2
    strayed_m = 0.5 * push_m_s2 * unanswered_s**2 + 0.5 * (push_m_s2 * unanswered_s) ** 2 / left_m_s2
    return min(SHARE_MOST, float(shares[strayed_m <= STRAYED_M].max()))


def settling(flight: Flight, outcome: str) -> Settling:
    """How a flight's first follower met the push, from its true states."""
    spans = flight.spans(Phase.FORMATION)
    truth = flight.truth[flight.followers[0].sysid or 0]
    if not spans or spans[0].end_s < BEGIN_S + LATE_S:
        return Settling(outcome)
    pushed: Bool = (truth.t_s >= BEGIN_S) & (truth.t_s < spans[0].end_s)
    hover = truth["q_lab_from_flu"][(truth.t_s >= BEGIN_S - LATE_S) & (truth.t_s < BEGIN_S)]
    t_s = truth.t_s[pushed] - BEGIN_S
    pos = truth["pos_lab_m"][pushed]
    angle_deg = swing(truth["q_lab_from_flu"][pushed], t_s >= t_s[-1] - LATE_S)
    return Settling(
        outcome,
        float(angle_deg[t_s >= t_s[-1] - LATE_S].max()),
        float(swing(hover, np.ones(len(hover), np.bool_)).max()),
        settled_s(t_s, angle_deg),
        float(np.linalg.norm(pos - pos[0], axis=-1).max()),
    )


def swing(q_lab_from_flu: Float, late: Bool) -> Float:
    """Angle (T,) of the thrust axis off its mean over the `late` states (T,), degrees; q (T, 4)."""
    axis = frames.rotate(q_lab_from_flu, np.broadcast_to(np.array([0.0, 0.0, 1.0]), (len(q_lab_from_flu), 3)))
    mean = axis[late].mean(axis=0)
    angle: Float = np.degrees(np.arccos(np.clip(axis @ mean / np.linalg.norm(mean), -1.0, 1.0)))
    return angle


def settled_s(t_s: Float, angle_deg: Float) -> float:
    """When the angle was larger than SETTLED_DEG last; 0 where it never was."""
    outside = np.flatnonzero(angle_deg > SETTLED_DEG)
    return float(t_s[outside[-1]]) if outside.size else 0.0
