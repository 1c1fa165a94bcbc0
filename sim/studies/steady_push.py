"""`gcs-sim steady-push`: does a hovering drone come to rest in a push that begins at once and stays?

The push is a share of what the tilt limit can hold against, over slower motors than the controller believes: the
operating range in which the loop must have one rest and no limit cycle.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import tan

import numpy as np

from analysis.load import Flight
from drone_agent.simulation.disturbance import Disturbance, SweptFan
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.messages import Phase
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PAPER_40G, VehicleProfile
from sim import lockstep
from sim.scenario import Scenario, TrueVehicle
from sim.studies import experiments
from sim.studies.experiments import Experiment, Job

SHARES = (0.3, 0.6, 0.9)
"""Of the push that the tilt limit holds against."""
MOTOR_LAGS = (1.0, 1.3, 1.6)
"""True motor lag over the profile's."""
BEGIN_S, LATE_S = 10.0, 3.0
FORMATION_S = 14.0
WALL = SweptFan(pos_lab_m=(3.0, 0.0, 0.3), sweep_rad=0.0, diameter_m=20.0, start_s=BEGIN_S)
"""A fan so wide that it pushes alike wherever the drone goes."""
SETTLED_DEG, CALM_DEG = 1.0, 0.5
"""Settled: within SETTLED_DEG of the tilt that holds against the push; calm: the most that it still swings then."""


@dataclass(frozen=True, slots=True)
class Push:
    """One flight: which controller and vehicle, in a push of that share, with motors so much slower, by which seed."""

    share: float
    motor_lag: float = 1.0
    controller: str = "cfc"
    vehicle: VehicleProfile = PAPER_40G
    seed: int = 1


@dataclass(frozen=True, slots=True)
class Settling:
    """How a push was met; NaN where the formation ended before.

    swing_deg: largest angle of the thrust axis off its mean in the last LATE_S; settle_s: from the push until it stays
    within SETTLED_DEG of that; deviation_m: largest of the position.
    """

    outcome: str
    swing_deg: float = np.nan
    settle_s: float = np.nan
    deviation_m: float = np.nan

    @property
    def at_rest(self) -> bool:
        """Whether it landed, and did not swing at last."""
        return self.outcome == "landed" and self.swing_deg <= CALM_DEG


def jobs(controllers: Sequence[str], vehicle: VehicleProfile, seeds: Sequence[int]) -> list[Push]:
    """Every flight of the sweep; ValueError names the known controllers."""
    if unknown := set(controllers) - set(experiments.CONTROLLERS):
        raise ValueError(f"unknown controller {min(unknown)!r}; known: {', '.join(experiments.CONTROLLERS)}")
    return [Push(s, lag, c, vehicle, n) for c in controllers for s in SHARES for lag in MOTOR_LAGS for n in seeds]


def scenario_of(job: Push) -> Scenario:
    """The hover of the gust experiment in that push."""
    scenario = experiments.scenario_of(Job(job.controller, Experiment.GUST, job.seed, vehicle=job.vehicle))
    slower: dict[str, float | bool | tuple[float, float, float]] = {
        "motor_lag_s": job.motor_lag * job.vehicle.motor_lag_s
    }
    vehicles = tuple(
        TrueVehicle(sysid=v.sysid, start=scenario.true_vehicle(v.sysid).start, vehicle=slower)
        for v in scenario.lab.vehicles
        if v.sysid is not None
    )
    return scenario.model_copy(update={"name": "steady_push", "vehicles": vehicles} | push_of(scenario, job.share))


def push_of(scenario: Scenario, share: float) -> dict[str, object]:
    """What changes of a hover in a push of that share."""
    push_m_s2 = share * GRAVITY_M_S2 * tan(scenario.lab.limits.tilt_rad)
    fan = WALL.model_copy(update={"peak_m_s2": push_m_s2})
    return {"air": Disturbance(fan=fan), "formation_s": FORMATION_S}


def fly(job: Push) -> Settling:
    """Fly the job and measure it."""
    flown, flight = lockstep.run_and_load(scenario_of(job), job.seed)
    return measure(flight, flown.outcome.result)


def measure(flight: Flight, outcome: str) -> Settling:
    """The numbers of a flight's first follower, from its true states."""
    spans = flight.spans(Phase.FORMATION)
    truth = flight.truth[flight.followers[0].sysid or 0]
    if not spans or spans[0].end_s < BEGIN_S + LATE_S:
        return Settling(outcome)
    pushed: Bool = (truth.t_s >= BEGIN_S) & (truth.t_s < spans[0].end_s)
    t_s = truth.t_s[pushed] - BEGIN_S
    pos = truth.column(lambda m: m.pos_lab_m)[pushed]
    angle_deg = swing(truth.column(lambda m: m.q_lab_from_flu)[pushed], t_s >= t_s[-1] - LATE_S)
    return Settling(
        outcome,
        float(angle_deg[t_s >= t_s[-1] - LATE_S].max()),
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
