from pathlib import Path

import numpy as np
import pytest

from formation.maths import frames
from mocap.sources.csv_file import MocapFileError
from sim.scenario import agent_configs, leader_seconds, load, recorded_leader, shipped, with_leader_file
from wire.config_file import ConfigError, dump

HEADER = "#timestamp [ns],x,y,z,qw,qx,qy,qz\n"


def a_recording(folder: Path, yaw_rad: float = 0.0, marker_yaw_rad: float = 0.0) -> Path:
    """A body that stands at (1, 2, 1.5) for 3 s; its marker frame is turned by marker_yaw against the body."""
    w, x, y, z = frames.from_yaw(np.array(yaw_rad - marker_yaw_rad))
    lines = (f"{10_000_000 * k},1.0,2.0,1.5,{w},{x},{y},{z}\n" for k in range(300))
    path = folder / "leader.csv"
    path.write_text(HEADER + "".join(lines))
    return path


@pytest.mark.parametrize("name", sorted(shipped()))
def test_every_shipped_scenario_loads_says_what_it_is_and_survives_a_round_trip(name: str, tmp_path: Path) -> None:
    scenario = load(name)
    assert scenario.name == name
    assert scenario.about
    copy = tmp_path / "copy.toml"
    copy.write_text(dump(scenario))
    assert load(str(copy)) == scenario


def test_a_name_that_is_none_is_refused_with_those_that_are() -> None:
    with pytest.raises(ConfigError, match="triangle_line"):
        load("triangle_lane")


def test_an_unknown_key_and_a_drone_that_is_not_in_the_lab_are_named(tmp_path: Path) -> None:
    text = dump(load("triangle_line"))
    wrong = tmp_path / "wrong.toml"
    wrong.write_text("altitude = 3\n" + text)
    with pytest.raises(ConfigError, match="altitude"):
        load(str(wrong))
    wrong.write_text(text.replace("vehicles = []", "vehicles = [{ sysid = 9 }]"))
    with pytest.raises(ConfigError, match="sysid 9 is not in the lab"):
        load(str(wrong))


def test_followers_stand_on_the_floor_below_their_slots() -> None:
    scenario = load("triangle_line")
    leader, right, left = agent_configs(scenario, recorded_leader(scenario))
    assert leader.start_lab_m == (0.0, 0.0, 0.0)
    assert np.allclose(right.start_lab_m, (-0.4, -0.4, 0.0))
    assert np.allclose(left.start_lab_m, (-0.4, 0.4, 0.0))
    assert {leader.pose, right.pose, left.pose} == {"mocap"}


def test_behind_a_recorded_leader_slots_turn_with_its_heading(tmp_path: Path) -> None:
    """Facing lab left, `behind and right` of the leader is -y and +x."""
    scenario = with_leader_file(load("vicon_leader"), str(a_recording(tmp_path, yaw_rad=np.pi / 2)))
    right, left = agent_configs(scenario, recorded_leader(scenario))
    assert np.allclose(right.start_lab_m, (1.4, 1.6, 0.0))
    assert np.allclose(left.start_lab_m, (0.6, 1.6, 0.0))
    assert np.isclose(right.start_yaw_rad, np.pi / 2)


def test_the_alignment_turns_the_marker_frame_into_the_body(tmp_path: Path) -> None:
    turned = np.pi / 3
    w, x, y, z = (float(v) for v in frames.from_yaw(np.array(turned)))
    recording = a_recording(tmp_path, yaw_rad=np.pi / 2, marker_yaw_rad=turned)
    scenario = with_leader_file(load("vicon_leader"), str(recording), (w, x, y, z))
    right, _ = agent_configs(scenario, recorded_leader(scenario))
    assert np.allclose(right.start_lab_m, (1.4, 1.6, 0.0))
    assert scenario.lab.leader.q_marker_from_flu == (w, x, y, z)


def test_a_recording_says_how_long_the_leader_is_on_its_way(tmp_path: Path) -> None:
    scenario = with_leader_file(load("vicon_leader"), str(a_recording(tmp_path)))
    assert leader_seconds(scenario, recorded_leader(scenario)) == pytest.approx(2.99 + 0.5)
    assert leader_seconds(load("triangle_line"), None) is None
    assert leader_seconds(load("hover_gust"), recorded_leader(load("hover_gust"))) == 26.0


def test_a_drone_cannot_be_a_recorded_leader_and_a_bad_line_is_named(tmp_path: Path) -> None:
    recording = a_recording(tmp_path)
    with pytest.raises(ValueError, match="sysid 1"):
        with_leader_file(load("triangle_line"), str(recording))
    recording.write_text(recording.read_text() + "5,1,2,3,1,0,0,0\n")
    with pytest.raises(MocapFileError, match=r"leader\.csv:302"):
        recorded_leader(with_leader_file(load("vicon_leader"), str(recording)))


def test_a_recording_named_in_a_scenario_lies_beside_it(tmp_path: Path) -> None:
    a_recording(tmp_path)
    scenario = load("vicon_leader")
    path = tmp_path / "mine.toml"
    leader = scenario.leader.model_copy(update={"file": "leader.csv"})
    path.write_text(dump(scenario.model_copy(update={"leader": leader})))
    assert load(str(path)).leader.file == str(tmp_path / "leader.csv")
