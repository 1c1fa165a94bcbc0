from pathlib import Path

import numpy as np
import pytest

from formation.maths import frames
from mocap.sources.csv_file import MocapFileError
from sim.scenario import agent_configs, load, recorded_leader, shipped, with_leader_file
from wire.config_file import dump

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


def test_behind_a_recorded_leader_slots_turn_with_its_heading(tmp_path: Path) -> None:
    """Facing lab left, `behind and right` of the leader is -y and +x."""
    scenario = with_leader_file(load("vicon_leader"), str(a_recording(tmp_path, yaw_rad=np.pi / 2)))
    right, left = agent_configs(scenario, recorded_leader(scenario))
    assert np.allclose(right.start_lab_m, (1.4, 1.6, 0.0))
    assert np.allclose(left.start_lab_m, (0.6, 1.6, 0.0))
    assert np.isclose(right.start_yaw_rad, np.pi / 2)


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
