"""Neural-Fly's recorded flights, and a figure-8 to fly in the force that they recorded.

The files are the user's to fetch, and never part of this project. A leader that no wind pushes flies the recorded
reference; one follower beside it is pushed by the residual force of the recorded baseline flight over its mass. A
replayed force does not react to our motion, and it holds whatever their thrust model missed, with the noise of its
differentiation.

O'Connell, Shi et al., "Neural-Fly enables rapid learning for agile flight in strong winds", Science Robotics 7 (2022);
github aerorobotics/neural-fly, data/experiment: custom_figure8_METHOD_CONDITION.csv, 50 Hz.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from analysis.imports import csv_file
from analysis.imports.recording import BadFileError
from formation.config import Fence, FlightConfig, FollowerConfig, LabConfig, LeaderConfig, LimitsConfig
from formation.maths.arrays import Float
from formation.trajectory_config import TrajectoryConfig
from formation.vehicle.profile import BatteryProfile, VehicleProfile
from sim.scenario import Pose, Scenario, TrueVehicle

SCENES: Mapping[str, str] = MappingProxyType(
    {
        "Neural-Fly, 0 m/s": "nowind",
        "Neural-Fly, 4.2 m/s": "35wind",
        "Neural-Fly, 8.5 m/s": "70wind",
        "Neural-Fly, 8.5 + 2.4 sin t": "70p20sint",
        "Neural-Fly, 12.1 m/s": "100wind",
    }
)
"""By the wind's speed as the article has it, and the condition by its name in the files."""
METHODS = ("baseline", "indi", "L1", "NF-C", "NF-T", "NF")
PUSHED_BY = "baseline"
"""Whose flight's residual force is replayed."""
SETTLED_S = 5.0
"""The article's figures are of what comes after."""
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
COLUMNS = [f"{name}[{axis}]" for name in ("p", "p_d", "fa") for axis in range(3)]


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """One flight: times (T,), s from 0; position and reference (T, 3), m; residual force (T, 3), N. Axes: z up."""

    t_s: Float
    pos_m: Float
    reference_m: Float
    residual_n: Float

    @property
    def rms_m(self) -> float:
        """Of the distance from the reference, once settled."""
        error_m = np.linalg.norm(self.pos_m - self.reference_m, axis=-1)[self.t_s > SETTLED_S]
        return float(np.sqrt(np.mean(error_m**2)))


def path_of(folder: Path, method: str, wind: str) -> Path:
    """Where a flight's file is looked for."""
    return folder / f"custom_figure8_{method}_{wind}.csv"


def pushed_by(folder: Path, scene: str) -> Path:
    """The file of the flight whose residual force is a scene's wind."""
    return path_of(folder, PUSHED_BY, SCENES[scene])


def read(path: Path) -> Recording:
    """The flight in a file; BadFileError, a ValueError, or OSError where it cannot be used."""

    def clock_of(names: Sequence[str]) -> tuple[str, float]:
        if missing := [name for name in ("t", *COLUMNS) if name not in names]:
            raise BadFileError(f"{path}: no column {missing[0]}")
        return "t", 1.0

    rows = csv_file.read(path, clock_of).tables[""]
    if wrong := [name for name in COLUMNS if not np.isfinite(rows.columns[name]).all()]:
        raise BadFileError(f"{path}: {wrong[0]} has values that are no finite number")
    pos_m, reference_m, residual_n = np.stack([rows.columns[name] for name in COLUMNS]).reshape(3, 3, -1)
    return Recording(rows.t_s - rows.t_s[0], pos_m.T, reference_m.T, residual_n.T)


def scenario_of(recording: Recording) -> Scenario:
    """The figure-8 as the leader's trajectory, and the follower beside it."""
    x, y, z = recording.reference_m[0].tolist()
    points = tuple((t, *at, 0.0) for t, at in zip(recording.t_s.tolist(), recording.reference_m.tolist(), strict=True))
    lab = LabConfig(
        profiles=(VEHICLE,),
        leader=LeaderConfig(body="leader", sysid=1, trajectory=TrajectoryConfig(kind="file", points=points)),
        followers=(
            FollowerConfig(body="follower", sysid=FOLLOWER_SYSID, profile=VEHICLE.name, offset_m=BESIDE_M),
        ),
        flight=FlightConfig(altitude_m=z),
        limits=LimitsConfig(
            tilt_rad=TILT_RAD, speed_m_s=5.0, fence=Fence(low_m=(-4.0, -5.0, -0.1), high_m=(4.0, 3.0, 4.5))
        ),
    )  # fmt: skip
    return Scenario(name="neural_fly", lab=lab, vehicles=(TrueVehicle(sysid=1, start=Pose(pos_lab_m=(x, y, 0.0))),))


def wind(recording: Recording, step_s: float) -> Float:
    """The push on the leader, none, and on the follower, every step_s from the trajectory's beginning: (K, 2, 3)."""
    since_s: Float = np.arange(0.0, float(recording.t_s[-1]), step_s)
    pushes = [np.interp(since_s, recording.t_s, force) for force in recording.residual_n.T / VEHICLE.mass_kg]
    pushed = np.stack(pushes, axis=1) * np.minimum(since_s / RISE_S, 1.0)[:, None]
    return np.stack([np.zeros_like(pushed), pushed], axis=1)


def flown_rms_m(folder: Path) -> dict[str, dict[str, float]]:
    """RMS distance from the reference of the article's own flights there, by method and scene; BadFileError."""
    return {
        method: {
            scene: read(path).rms_m
            for scene, wind in SCENES.items()
            if (path := path_of(folder, method, wind)).is_file()
        }
        for method in METHODS
    }
