"""The paper's three experiments, flown in lockstep, and what is measured in each.

The vehicle is `paper_40g`: attitude loop, 25 ms motor lag, drag and ground effect as in its profile; the scenarios add
8 ms mocap delay with a tail of 0.5 ms, 0.1 mm and 1 mrad of noise, 0.5 ms of exposure jitter, and links of 4 ms with a
tail of 0.5 ms each way. Every controller flies behind the same estimator inputs, limits, links and delays.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

import numpy as np

from analysis.load import Flight
from analysis.metrics import summarise
from analysis.series import nearest
from analysis.tracking import track
from drone_agent.simulation.disturbance import Disturbance
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.messages import Phase
from sim import lockstep
from sim.scenario import Scenario, load

CONTROLLERS: Mapping[str, str] = MappingProxyType(
    {
        "smc": "paper_smc",
        "istsmc": "paper_istsmc",
        "cfc_paper": "paper",
        "cfc": "default",
        "pid": "pid",
        "geometric": "geometric",
    }
)
"""Names as in paper.json, and the control preset each is."""

FORMATION_S = 20.0
SETTLED_M = 0.01
PUSHED = 0.05
"""A gust is on while it pushes with more than this share of its peak."""
HOVER_CALM_S = 1.0


class Experiment(StrEnum):
    """The paper's Figures 5, 6 and 7."""

    GUST = "gust"
    LINE = "line"
    CIRCLE = "circle"


SCENARIOS: Mapping[Experiment, str] = MappingProxyType(
    {Experiment.GUST: "hover_gust", Experiment.LINE: "triangle_line", Experiment.CIRCLE: "triangle_circle"}
)


@dataclass(frozen=True, slots=True)
class Job:
    """One flight: who flies what, with which luck; gust_peak_m_s2: instead of the scenario's own."""

    controller: str
    experiment: Experiment
    seed: int
    traced: bool = False
    gust_peak_m_s2: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """What the figures show, from the start of the formation: times (T,), and per follower (T, k, 2) in x and y.

    path_m (T, n, 2): where all vehicles truly or measurably were; error_m (T, k, 2): off the slot, in the leader's
    frame; gust_m_s2, z3_m_s2 (T,): true push and its estimate along x of the first follower.
    """

    t_s: Float
    path_m: Float
    error_m: Float
    gust_m_s2: Float
    z3_m_s2: Float


@dataclass(frozen=True, slots=True)
class Score:
    """One flight's numbers; NaN where this experiment does not tell.

    max_dev_m: largest deviation in x while the gust sweeps; settle_s: from the end of each push until the deviation
    stays within 1 cm (at most until the next push), mean; z3_error_m_s2: RMS of Z3 against the true push, x;
    chatter_deg: RMS change of the commanded tilt from tick to tick, in hover before the gust; rms_m, vibration_m:
    analysis.metrics.
    """

    outcome: str
    max_dev_m: float
    settle_s: float
    z3_error_m_s2: float
    chatter_deg: float
    rms_m: float
    vibration_m: float
    trace: Trace | None


def scenario_of(job: Job) -> Scenario:
    """The shipped scenario with the job's controller, at least 20 s of formation."""
    scenario = load(SCENARIOS[job.experiment])
    lab = scenario.lab.model_copy(update={"control_preset": CONTROLLERS[job.controller]})
    update: dict[str, object] = {"lab": lab}
    if job.experiment is Experiment.LINE:
        update["formation_s"] = FORMATION_S
    fan = scenario.air.fan
    if fan is not None and job.gust_peak_m_s2 is not None:
        update["air"] = Disturbance(fan=fan.model_copy(update={"peak_m_s2": job.gust_peak_m_s2}))
    return scenario.model_copy(update=update)


def fly(job: Job) -> Score:
    """Fly the job and measure it."""
    scenario = scenario_of(job)
    flown, flight = lockstep.run_and_load(scenario, job.seed)
    return measure(flight, scenario, flown.outcome.result, job.traced)


def measure(flight: Flight, scenario: Scenario, outcome: str, traced: bool = False) -> Score:
    """The numbers of a flight of that scenario; those of the gust only where a fan blows."""
    summary = summarise(flight)
    return Score(
        outcome,
        *_gust_numbers(flight, scenario),
        np.nan if summary.formation_rms_m is None else summary.formation_rms_m,
        np.nan if summary.vibration_m is None else summary.vibration_m,
        _trace(flight) if traced else None,
    )


def _gust_numbers(flight: Flight, scenario: Scenario) -> tuple[float, float, float, float]:
    """max_dev_m, settle_s, z3_error_m_s2, chatter_deg of the one follower, from its true states."""
    fan = scenario.air.fan
    sysid = scenario.lab.followers[0].sysid
    spans = flight.spans(Phase.FORMATION)
    if fan is None or not spans or sysid not in flight.truth:
        return (np.nan,) * 4
    truth = flight.truth[sysid]
    blowing = (truth.t_s >= fan.start_s) & (truth.t_s <= spans[0].end_s)
    if not blowing.any():
        return (np.nan,) * 4
    slot = np.array(scenario.leader.pose.pos_lab_m) + np.array(scenario.lab.followers[0].offset_m)
    t_s = truth.t_s[blowing]
    deviation_m = np.abs(truth.column(lambda m: m.pos_lab_m)[blowing, 0] - slot[0])
    push = truth.column(lambda m: m.dist_lab_m_s2)[:, 0]
    at_state = nearest(truth.t_s, flight.state.t_s)
    estimated = flight.state.column(lambda m: m.dist_lab_m_s2[1, 0])
    during = (flight.state.t_s >= fan.start_s) & (flight.state.t_s <= spans[0].end_s)
    error = (estimated - push[at_state])[during]
    passes = _passes(np.abs(push[blowing]))
    return (
        float(deviation_m.max()),
        _settling(t_s, deviation_m, passes),
        float(np.sqrt(np.mean(error**2))),
        _chatter_deg(flight, spans[0].start_s, fan.start_s),
    )


def _passes(push_m_s2: Float) -> list[tuple[int, int, int]]:
    """Each pass of the gust: where its push begins and ends, and where the next one begins."""
    pushed: Bool = push_m_s2 > PUSHED * push_m_s2.max()
    begins = np.flatnonzero(~pushed[:-1] & pushed[1:]) + 1
    ends = np.flatnonzero(pushed[:-1] & ~pushed[1:]) + 1
    nexts = np.append(begins[1:], len(push_m_s2))
    return [(int(b), int(ends[ends > b][0]), int(n)) for b, n in zip(begins, nexts, strict=True) if np.any(ends > b)]


def _settling(t_s: Float, deviation_m: Float, passes: list[tuple[int, int, int]]) -> float:
    """Mean time from the end of a push until the deviation stays within 1 cm, at the latest the next push."""
    taken = []
    for _, end, after in passes:
        outside = np.flatnonzero(deviation_m[end:after] > SETTLED_M)
        taken.append(t_s[min(end + outside[-1] + 1, len(t_s) - 1)] - t_s[end] if outside.size else 0.0)
    return float(np.mean(taken)) if taken else np.nan


def _chatter_deg(flight: Flight, formation_s: float, gust_s: float) -> float:
    """RMS angle between the commanded thrust axes of successive ticks, degrees, in calm hover."""
    target = flight.target
    calm = (target.t_s > formation_s + HOVER_CALM_S) & (target.t_s < gust_s)
    q = target.column(lambda m: m.q_lab_from_flu[0])[calm]
    up = frames.rotate(q, np.broadcast_to(np.array([0.0, 0.0, 1.0]), (len(q), 3)))
    angle = np.linalg.norm(np.diff(up, axis=0), axis=-1)
    return float(np.degrees(np.sqrt(np.mean(angle**2)))) if len(angle) else np.nan


def _trace(flight: Flight) -> Trace:
    """Paths and errors of the formation phase, on the mocap's frames."""
    tracking = track(flight)
    spans = flight.spans(Phase.FORMATION)
    start_s = spans[0].start_s if spans else 0.0
    shown = tracking.formed.all(axis=1)
    at_pose = nearest(flight.poses.t_s, tracking.t_s[shown])
    truth = flight.truth[flight.followers[0].sysid or 0]
    at_truth, at_state = nearest(truth.t_s, tracking.t_s[shown]), nearest(flight.state.t_s, tracking.t_s[shown])
    return Trace(
        tracking.t_s[shown] - start_s,
        flight.poses.pos_lab_m[at_pose, :, :2],
        tracking.error_lead_m[shown, :, :2],
        truth.column(lambda m: m.dist_lab_m_s2[0])[at_truth],
        flight.state.column(lambda m: m.dist_lab_m_s2[1, 0])[at_state],
    )
