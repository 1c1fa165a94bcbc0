"""A flight is the same in any camera axes, and so is what becomes of it when the ground dies."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, pi, sin, sqrt
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from formation import topics
from formation.maths import frames
from formation.maths.arrays import Float
from formation.model import NO_ROTATION, QuatTuple, Vec3Tuple
from mocap.sources.csv_file import read_recording
from sim import lockstep
from sim.faults.fault import Family, Fault
from sim.scenario import Scenario, TrueVehicle, load, with_leader_file
from sim.world import World

HALF = sqrt(0.5)


@dataclass(frozen=True, slots=True)
class AxesConvention:
    """How the cameras' axes lie in the lab, and every body's marker frame on it."""

    q_lab_from_mocap: QuatTuple = NO_ROTATION
    origin_lab_m: Vec3Tuple = (0.0, 0.0, 0.0)
    q_marker_from_flu: QuatTuple = NO_ROTATION


def _about_z(angle_rad: float) -> QuatTuple:
    return cos(angle_rad / 2), 0.0, 0.0, sin(angle_rad / 2)


CAMERA_AXES: Mapping[str, AxesConvention] = MappingProxyType(
    {
        "30 degrees about z": AxesConvention(_about_z(pi / 6)),
        "90 degrees about z": AxesConvention(_about_z(pi / 2)),
        "180 degrees about z": AxesConvention(_about_z(pi)),
        "y up": AxesConvention((HALF, HALF, 0.0, 0.0)),
        "arbitrary": AxesConvention((0.7, -0.1, 0.5, sqrt(0.25)), (1.0, -2.0, 0.3), (0.5, 0.5, -0.5, 0.5)),
    }
)


def with_camera_axes(scenario: Scenario, axes: AxesConvention, folder: Path) -> Scenario:
    """The same flight in those camera axes; a recorded leader's file is written again into `folder`."""
    lab = scenario.lab
    turned = {"q_marker_from_flu": axes.q_marker_from_flu}
    mocap = {"q_lab_from_mocap": axes.q_lab_from_mocap, "origin_lab_m": axes.origin_lab_m}
    file = scenario.leader.file
    if file is not None:
        file = str(_turn_recording(Path(file), scenario, axes, folder / "leader.csv"))
    return scenario.model_copy(
        update={
            "lab": lab.model_copy(
                update={
                    "mocap": lab.mocap.model_copy(update=mocap),
                    "leader": lab.leader.model_copy(update=turned),
                    "followers": tuple(f.model_copy(update=turned) for f in lab.followers),
                }
            ),
            "leader": scenario.leader.model_copy(update={"file": file}),
        }
    )


def _turn_recording(path: Path, scenario: Scenario, axes: AxesConvention, out: Path) -> Path:
    """The leader's recording as cameras with those axes would have made it."""
    recording, mocap = read_recording(path), scenario.lab.mocap
    q_lab_from_mocap = np.array(mocap.q_lab_from_mocap)
    pos_lab_m = frames.rotate(q_lab_from_mocap, recording.pos_mocap_m) + np.array(mocap.origin_lab_m)
    q_lab_from_marker = frames.multiply(q_lab_from_mocap, recording.q_mocap_from_marker)
    q_lab_from_flu = frames.multiply(q_lab_from_marker, np.array(scenario.lab.leader.q_marker_from_flu))
    back = frames.inverse(np.array(axes.q_lab_from_mocap))
    pos = frames.rotate(back, pos_lab_m - np.array(axes.origin_lab_m))
    q = frames.multiply(frames.multiply(back, q_lab_from_flu), frames.inverse(np.array(axes.q_marker_from_flu)))
    rows = (
        f"{t}," + ",".join(map(repr, [*p, *r]))
        for t, p, r in zip(recording.t_ns, pos.tolist(), q.tolist(), strict=True)
    )
    out.write_text("\n".join(rows), encoding="utf-8")
    return out


def paths_of(scenario: Scenario, seed: int = 7) -> tuple[str, dict[int, Float]]:
    """How the flight ended, and each drone's true positions, (T, 3) in lab."""
    flown, records = lockstep.run_in_memory(scenario, seed)
    paths: dict[int, list[Float]] = {}
    for record in records:
        if record.topic is topics.TRUTH:
            paths.setdefault(record.message.sysid, []).append(record.message.pos_lab_m)
    return flown.outcome.result, {sysid: np.array(path) for sysid, path in paths.items()}


def max_distance_m(one: dict[int, Float], other: dict[int, Float]) -> float:
    """The largest distance between the same drone at the same time in two flights."""
    assert {sysid: path.shape for sysid, path in one.items()} == {sysid: path.shape for sysid, path in other.items()}
    return max(float(np.abs(one[sysid] - other[sysid]).max()) for sysid in one)


ROUNDING_M = 1e-8
S = 1_000_000_000


def short(name: str) -> Scenario:
    """The scenario's own take-off and what follows of it in a few seconds."""
    return load(name).model_copy(update={"longest_s": 9.0})


def recorded(folder: Path) -> Scenario:
    """Behind a leader that walks a figure with turns and heights, recorded by cameras of their own axes."""
    t = np.arange(0.0, 6.0, 0.01)
    pos = np.stack([0.3 * np.sin(t), 0.2 * np.sin(2.0 * t), 1.0 + 0.1 * np.sin(1.5 * t)], axis=-1)
    yaw = 0.5 * np.sin(t)
    rows = np.column_stack([pos, np.cos(0.5 * yaw), 0.0 * t, 0.0 * t, np.sin(0.5 * yaw)])
    file = folder / "recorded.csv"
    file.write_text(
        "\n".join(f"{round(1e9 * s)}," + ",".join(map(repr, row)) for s, row in zip(t, rows.tolist(), strict=True))
    )
    return with_leader_file(load("vicon_leader"), str(file)).model_copy(update={"longest_s": 15.0})


NIGHTLY = [pytest.param(name, marks=pytest.mark.nightly) for name in ("triangle_circle", "hover_gust", "px4_circle")]


@pytest.mark.parametrize("name", ["yawing_leader", *NIGHTLY])
def test_every_kind_of_flight_is_the_same_with_arbitrary_camera_axes(name, tmp_path):
    scenario = short(name)
    _, plain = paths_of(scenario)
    _, turned = paths_of(with_camera_axes(scenario, CAMERA_AXES["arbitrary"], tmp_path))
    assert max_distance_m(plain, turned) < ROUNDING_M


def test_a_recorded_leader_is_followed_the_same_with_arbitrary_camera_axes(tmp_path):
    scenario = recorded(tmp_path)
    _, plain = paths_of(scenario)
    _, turned = paths_of(with_camera_axes(scenario, CAMERA_AXES["arbitrary"], tmp_path))
    assert max_distance_m(plain, turned) < ROUNDING_M


@pytest.mark.parametrize(
    "axes", [pytest.param(axes, marks=[pytest.mark.nightly] * (axes != "arbitrary")) for axes in CAMERA_AXES]
)
def test_agents_and_bridge_hold_and_land_with_any_camera_axes_when_the_ground_dies(axes, tmp_path):
    flown = {
        "vehicles": (TrueVehicle(sysid=2, bridged=True),),
        "faults": (Fault(family=Family.KILL, core="ground", after_s=1.0),),
    }
    scenario = with_camera_axes(load("triangle_line").model_copy(update=flown), CAMERA_AXES[axes], tmp_path)
    world = World(scenario, 7, lambda _topic, _message, _t_ns: None)
    while world.faults.first_ns is None:
        world.step()
    killed_ns, flying = world.now_ns, world.truths()
    assert min(truth.pos_lab_m[2] for truth in flying.values()) > 0.2
    while world.now_ns < killed_ns + 8 * S:
        world.step()
    landed = world.truths()
    assert all(truth.on_ground for truth in landed.values())
    for sysid, truth in landed.items():
        assert np.linalg.norm(truth.pos_lab_m[:2] - flying[sysid].pos_lab_m[:2]) < 0.4
