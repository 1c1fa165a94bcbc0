"""The recorded figure-8 in the recorded force of its wind, flown by the whole stack.

A leader that no wind pushes flies the recorded reference; one follower beside it is pushed by the residual force of
the recorded baseline flight over its mass, and judged by its distance from the reference. The article's vehicles flew,
ours is simulated. A replayed force does not react to our motion, and it holds whatever their thrust model missed, with
the noise of its differentiation.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.load import from_records
from analysis.tracking import reference_lab_m
from bench.neural_fly.recordings import PUSHED_BY, SETTLED_S, WINDS, Recording, path_of, read
from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.attitude_loop import OWN, WHOLE_MOTORS, Physics, advance
from formation.config import Fence, FlightConfig, FollowerConfig, LabConfig, LeaderConfig, LimitsConfig, LinkConfig
from formation.maths.arrays import Float, Vec3
from formation.messages import Phase, PhaseChange, Reference
from formation.topics import Topic
from formation.trajectory_config import TrajectoryConfig
from formation.vehicle.profile import BatteryProfile, VehicleProfile, VehicleState
from sim import lockstep
from sim.scenario import Pose, Scenario, TrueVehicle
from sim.studies.experiments import CONTROLLERS, IMU_RATE_HZ
from sim.world import T0_NS
from wire.logs.mcap_read import Entry

VEHICLE = VehicleProfile(
    name="neural_fly_2644g",
    mass_kg=2.644,
    inertia_kg_m2=(0.0287, 0.0287, 0.053),
    wheelbase_m=0.5,
    rotor_radius_m=0.127,
    thrust_max_n=53.4,
    thrust_curve=0.0,
    yaw_torque_m=0.016,
    motor_lag_s=0.04,
    ground_effect=0.0,
    attitude_p_1_s=8.0,
    yaw_p_1_s=2.8,
    rate_p_1_s=25.0,
    rate_yaw_p_1_s=8.0,
    rate_max_rad_s=3.8,
    rate_yaw_max_rad_s=3.5,
    rate_feed_forward=False,
    command_delay_s=0.016,
    response_dead_time_s=0.083,
    response_lag_s=0.063,
    thrust_dead_time_s=0.02,
    thrust_lag_s=0.04,
    battery=BatteryProfile(cells=6, capacity_mah=5000.0, hover_current_a=20.0),
)
"""What our drone is, and is believed to be.

Mass: the article's. Full thrust: 0.485 of it hovers, the mean of the recorded hover throttles. Attitude answer: 146 ms
in all, as the recorded attitudes follow theirs (0.14 to 0.16 s by flight). Thrust answer: 60 ms in all; by flight the
recordings say 15 to 65 ms where no wind blows, and nothing where one does. Inertia as of x500, by mass. No drag: it is
in the residual force. Assumed: rate gains and limits, battery.
"""
FOLLOWER_SYSID = 2
BESIDE_M = (0.0, -2.0, 0.0)
TILT_RAD = 0.8
"""More than the 0.75 rad that the recorded vehicle tilted; its wind needs 0.54 to hover in."""
RISE_S = 0.5
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
        self._t_s, self._push_m_s2 = recording.t_s, recording.residual_n / VEHICLE.mass_kg

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
        if not 0.0 < since_s < self._t_s[-1]:
            return np.zeros(3)
        push = np.array([np.interp(since_s, self._t_s, self._push_m_s2[:, axis]) for axis in range(3)])
        return push * min(since_s / RISE_S, 1.0)

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
    """The figure-8 as the leader's trajectory, and the follower beside it."""
    x, y, z = recording.reference_m[0].tolist()
    points = tuple((t, *at, 0.0) for t, at in zip(recording.t_s.tolist(), recording.reference_m.tolist(), strict=True))
    lab = LabConfig(
        profiles=(VEHICLE,),
        leader=LeaderConfig(body="leader", sysid=1, trajectory=TrajectoryConfig(kind="csv", points=points)),
        followers=(
            FollowerConfig(body="follower", sysid=FOLLOWER_SYSID, profile=VEHICLE.name, offset_m=BESIDE_M),
        ),
        control_preset=CONTROLLERS[job.controller],
        link=LinkConfig(imu_rate_hz=IMU_RATE_HZ.get(job.controller, 0.0)),
        flight=FlightConfig(altitude_m=z),
        limits=LimitsConfig(
            tilt_rad=TILT_RAD, speed_m_s=5.0, fence=Fence(low_m=(-4.0, -5.0, -0.1), high_m=(4.0, 3.0, 4.5))
        ),
    )  # fmt: skip
    start = TrueVehicle(sysid=1, start=Pose(pos_lab_m=(x, y, 0.0)))
    return Scenario(name=f"neural_fly_{job.wind}", lab=lab, vehicles=(start,))


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
