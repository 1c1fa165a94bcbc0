"""The paper's three experiments, and a steady push for searches and the league; and what is measured in each.

The vehicle is `paper_40g`, or any other: attitude loop, motor lag, drag and ground effect as in its profile; the
scenarios add 8 ms mocap delay with a tail of 0.5 ms, 0.1 mm and 1 mrad of noise, 0.5 ms of exposure jitter, and links
of 4 ms with a tail of 0.5 ms each way. Every controller flies behind the same estimator inputs, limits, links, delays
and monitors.
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
from formation.maths.arrays import Float
from formation.messages import Phase
from formation.vehicle.profile import PAPER_40G, VehicleProfile
from sim.research import host
from sim.research.gust import GustNumbers, gust_numbers
from sim.research.host import Host
from sim.research.mismatch import MISMATCHES, off_by
from sim.research.push import Settling, push_of, settling, share_most
from sim.scenario import Scenario, flown_by, load

CONTROLLERS: Mapping[str, str] = MappingProxyType(
    {
        "smc": "paper_smc",
        "istsmc": "paper_istsmc",
        "cfc_paper": "paper",
        "cfc": "default",
        "cfc_imu": "default",
        "pid": "pid",
        "geometric": "geometric",
    }
)
"""Names as in paper.json, and the control preset each is."""

IMU_RATE_HZ: Mapping[str, float] = MappingProxyType({"cfc_imu": 200.0})
"""Controllers that get the drones' accelerometer samples (HIGHRES_IMU, 0.3 m/s^2 of noise), with the rate, Hz."""

GUST_PEAKS_M_S2: Mapping[str, float] = MappingProxyType({"paper_40g_printed": 7.0})
"""The fan that moves the printed ISTSMC of that vehicle by 0.30 m, as `bench.calibrate_fan` found it: by the mean over
the passes, median of the seeds 101 to 106, 297 mm; for every other vehicle the fan of the scenario, found in the same
way with `paper_40g`, 299 mm."""

FORMATION_S = 20.0


class Experiment(StrEnum):
    """The paper's Figures 5, 6 and 7; and a push that begins at once and stays, which the paper does not have."""

    GUST = "gust"
    LINE = "line"
    CIRCLE = "circle"
    PUSH = "push"


SCENARIOS: Mapping[Experiment, str] = MappingProxyType(
    {
        Experiment.GUST: "hover_gust",
        Experiment.LINE: "triangle_line",
        Experiment.CIRCLE: "triangle_circle",
        Experiment.PUSH: "hover_gust",
    }
)


@dataclass(frozen=True, slots=True)
class Job:
    """One flight: who flies what, with which luck.

    gust_peak_m_s2: instead of the vehicle's own (`GUST_PEAKS_M_S2`); push_share: instead of the hardest steady push
    (sim.research.push); mismatch: what the vehicle is not as believed, by its name in sim.research.mismatch.
    """

    controller: str
    experiment: Experiment
    seed: int
    traced: bool = False
    vehicle: VehicleProfile = PAPER_40G
    gust_peak_m_s2: float | None = None
    push_share: float | None = None
    mismatch: str | None = None
    host: Host = Host.STUDY


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
    """One flight's numbers; NaN where this experiment does not measure them.

    rms_m, vibration_m: analysis.metrics.
    """

    outcome: str
    gust: GustNumbers
    push: Settling
    rms_m: float
    vibration_m: float
    trace: Trace | None


def scenario_of(job: Job) -> Scenario:
    """The shipped scenario with the job's vehicle and controller, at least 20 s of formation."""
    scenario = load(SCENARIOS[job.experiment])
    lab = flown_by(scenario.lab, job.vehicle, CONTROLLERS[job.controller])
    link = lab.link.model_copy(update={"imu_rate_hz": IMU_RATE_HZ.get(job.controller, 0.0)})
    update: dict[str, object] = {"lab": lab.model_copy(update={"link": link})}
    if job.experiment is Experiment.LINE:
        update["formation_s"] = FORMATION_S
    if job.experiment is Experiment.PUSH:
        share = share_most(job.vehicle, lab.limits.tilt_rad) if job.push_share is None else job.push_share
        update |= {"name": "steady_push"} | push_of(lab, share)
    elif scenario.air.fan is not None:
        peak = gust_peak_m_s2(job.vehicle) if job.gust_peak_m_s2 is None else job.gust_peak_m_s2
        update["air"] = Disturbance(fan=scenario.air.fan.model_copy(update={"peak_m_s2": peak}))
    flown = scenario.model_copy(update=update)
    return flown if job.mismatch is None else off_by(flown, MISMATCHES[job.mismatch])


def gust_peak_m_s2(vehicle: VehicleProfile) -> float:
    """The strength of the fan that a vehicle is flown in."""
    fan = load(SCENARIOS[Experiment.GUST]).air.fan
    return GUST_PEAKS_M_S2.get(vehicle.name, 0.0 if fan is None else fan.peak_m_s2)


def fly(job: Job) -> Score:
    """Fly the job and measure it."""
    scenario = scenario_of(job)
    result, flight = host.fly(scenario, job.seed, host=job.host)
    return measure(flight, scenario, result, job.experiment, job.traced)


def measure(flight: Flight, scenario: Scenario, outcome: str, experiment: Experiment, traced: bool = False) -> Score:
    """The numbers of a flight of that scenario."""
    summary = summarise(flight)
    return Score(
        outcome,
        gust_numbers(flight, scenario) if experiment is Experiment.GUST else GustNumbers(),
        settling(flight, outcome) if experiment is Experiment.PUSH else Settling(outcome),
        np.nan if summary.formation_rms_m is None else summary.formation_rms_m,
        np.nan if summary.vibration_m is None else summary.vibration_m,
        _trace(flight) if traced else None,
    )


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
        truth["dist_lab_m_s2"][:, 0][at_truth],
        flight.state["dist_lab_m_s2"][:, 1, 0][at_state],
    )
