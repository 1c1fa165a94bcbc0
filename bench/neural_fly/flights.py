"""Neural-Fly's recorded figure-8 in its wind (sim.studies.neural_fly), flown by the whole stack in lockstep.

The pushed follower is judged by its distance from the reference. The article's vehicles flew, ours is simulated.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.load import from_records
from analysis.tracking import reference_lab_m
from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.attitude_loop import OWN, WHOLE_MOTORS, Physics, advance
from formation.config import LinkConfig
from formation.maths.arrays import Float, Vec3
from formation.messages import Phase, PhaseChange, Reference
from formation.topics import Topic
from formation.vehicle.profile import VehicleProfile, VehicleState
from sim import lockstep
from sim.scenario import Scenario
from sim.studies import neural_fly
from sim.studies.experiments import CONTROLLERS, IMU_RATE_HZ
from sim.studies.neural_fly import (
    BESIDE_M,
    FOLLOWER_SYSID,
    PUSHED_BY,
    SETTLED_S,
    VEHICLE,
    WINDS,
    Recording,
    path_of,
    push_lab_m_s2,
    read,
)
from sim.world import T0_NS
from wire.logs.mcap_read import Entry

SHOWN = ("cfc", "cfc_imu", "pid", "geometric")


@dataclass(frozen=True, slots=True)
class Job:
    """One flight: which controller in which wind, by which seed; folder: where the recordings are."""

    controller: str
    wind: str
    folder: Path
    seed: int = 1


@dataclass(frozen=True, slots=True)
class Score:
    """How it ended; RMS and largest distance from the reference after SETTLED_S, RMS of the height alone; NaN: none."""

    outcome: str
    rms_m: float = np.nan
    max_m: float = np.nan
    height_rms_m: float = np.nan


class ReplayedWind:
    """The residual force of a recording as a push on drones of VEHICLE, from when the leader's trajectory begins.

    It is synchronised by the records of the flight.
    """

    def __init__(self, recording: Recording) -> None:
        self.start_ns: int | None = None
        self._now_ns = T0_NS
        self._phase = Phase.GROUND
        self._recording = recording

    def receive(self, message: object, t_ns: int) -> None:
        """One record of the flight."""
        self._now_ns = t_ns
        if isinstance(message, PhaseChange):
            self._phase = message.phase
        elif isinstance(message, Reference) and self.start_ns is None and self._phase is Phase.FORMATION:
            moves = message.origin_vel_lab_m_s[0].any() or message.slot_vel_lead_m_s[0].any()
            self.start_ns = t_ns if moves else None

    def push_lab_m_s2(self) -> Vec3:
        """The push now; none before the trajectory begins and after the recording's end."""
        since_s = 0.0 if self.start_ns is None else (self._now_ns - self.start_ns) * 1e-9
        push: Vec3 = push_lab_m_s2(self._recording, np.array([since_s]))[0]
        return push

    def advance(
        self,
        state: VehicleState,
        profile: VehicleProfile,
        setpoint: LoopSetpoint,
        armed: bool,
        dist_lab_m_s2: Float,
        dt_s: float,
        steps: int,
        thrust_scale: float = 1.0,
        motor_gain: Float = WHOLE_MOTORS,
    ) -> VehicleState:
        """As drone_agent.simulation.attitude_loop.advance, in this wind."""
        push = self.push_lab_m_s2() if profile.name == VEHICLE.name else 0.0
        return advance(state, profile, setpoint, armed, dist_lab_m_s2 + push, dt_s, steps, thrust_scale, motor_gain)


def jobs(folder: Path, controllers: Sequence[str], seed: int = 1) -> list[Job]:
    """Every wind with every controller; ValueError names the known controllers."""
    if unknown := set(controllers) - set(CONTROLLERS):
        raise ValueError(f"unknown controller {min(unknown)!r}; known: {', '.join(CONTROLLERS)}")
    return [Job(controller, wind, folder, seed) for controller in controllers for wind in WINDS]


def scenario_of(job: Job, recording: Recording) -> Scenario:
    """The recorded figure-8 by the job's controller."""
    scenario = neural_fly.scenario_of(recording)
    link = LinkConfig(imu_rate_hz=IMU_RATE_HZ.get(job.controller, 0.0))
    update = {"control_preset": CONTROLLERS[job.controller], "link": link}
    return scenario.model_copy(update={"lab": scenario.lab.model_copy(update=update)})


def fly(job: Job) -> Score:
    """Fly one wind, as the paper's experiments; RecordingError where its recording cannot be used."""
    recording = read(path_of(job.folder, PUSHED_BY, job.wind))
    scenario, wind = scenario_of(job, recording), ReplayedWind(recording)
    records: list[Entry] = []

    def record(topic: Topic, message: object, t_ns: int) -> None:
        wind.receive(message, t_ns)
        records.append(Entry(topic, t_ns, message))

    flown = lockstep.fly(scenario, job.seed, record, physics=Physics(OWN.step_ns, wind.advance))
    if wind.start_ns is None:
        return Score(flown.outcome.result)
    flight = from_records(lockstep.metadata(scenario, job.seed, "memory", T0_NS), records)
    truth, path = flight.truth[FOLLOWER_SYSID], reference_lab_m(flight.reference)[:, 0] + np.array(BESIDE_M)
    # The trajectory began between two frames: the reference in the log knows when, to the nanosecond.
    wanted_m = [np.interp(truth.t_s, flight.reference.t_s, path[:, axis]) for axis in range(3)]
    since_s = (truth["t_ns"] - wind.start_ns) * 1e-9
    judged = (since_s > SETTLED_S) & (since_s < recording.t_s[-1])
    error_m = truth["pos_lab_m"] - np.stack(wanted_m, axis=-1)
    return score(flown.outcome.result, error_m[judged])


def score(outcome: str, error_m: Float) -> Score:
    """The numbers of true errors (T, 3)."""
    if not len(error_m):
        return Score(outcome)
    distance_m = np.linalg.norm(error_m, axis=-1)
    return Score(
        outcome,
        float(np.sqrt(np.mean(distance_m**2))),
        float(distance_m.max()),
        float(np.sqrt(np.mean(error_m[:, 2] ** 2))),
    )
