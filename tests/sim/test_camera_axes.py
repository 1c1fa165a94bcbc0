"""A flight is the same in any camera axes, and so is what becomes of it when the ground dies."""

from pathlib import Path

import numpy as np
import pytest

from formation.messages import Phase
from sim.scenario import Scenario, TrueVehicle, load, with_leader_file
from sim.world import World
from tools.camera_axes import CAMERA_AXES, max_distance_m, paths_of, with_camera_axes

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
    bridged = TrueVehicle(sysid=2, bridged=True)
    scenario = with_camera_axes(
        load("triangle_line").model_copy(update={"vehicles": (bridged,)}), CAMERA_AXES[axes], tmp_path
    )
    world = World(scenario, 7, lambda _topic, _message, _t_ns: None)
    while world.operator.phase is not Phase.FORMATION:
        world.step()
    killed_ns = world.now_ns + S
    while world.now_ns < killed_ns:
        world.step()
    world.kill_ground()
    flying = world.truths()
    assert min(truth.pos_lab_m[2] for truth in flying.values()) > 0.2
    while world.now_ns < killed_ns + 8 * S:
        world.step()
    landed = world.truths()
    assert all(truth.on_ground for truth in landed.values())
    for sysid, truth in landed.items():
        assert np.linalg.norm(truth.pos_lab_m[:2] - flying[sysid].pos_lab_m[:2]) < 0.4
