"""A lab's own file, flown by the simulator as it stands, and scenarios that are such a file and a few lines."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from formation.config import LabConfig
from sim.cli.app import app
from sim.scenario import find, load
from wire.config_file import ConfigError
from wire.config_file import load as load_file

LAB = """
name = "room_7"
flight = { altitude_m = 0.5 }
security = {}

[operator]
stop_button = { device = "/dev/input/js7" }

[mocap]
source = "vicon"
rate_hz = 200.0
delay_s = 0.005
axes = ["x forward", "y up", "z right"]
names = { "Rigid Body 1" = "leader" }

[mocap.vicon]
host = "192.168.1.10"

[link]
kind = "udp"
imu_rate_hz = 200.0

[leader]
body = "leader"
sysid = 1
spawn_lab_m = [0.3, 0.2, 0.0]
trajectory = { kind = "line", length_m = 0.1, duration_s = 1.0 }
trajectories.out = { kind = "line", length_m = 0.2, duration_s = 1.0 }

[[followers]]
body = "left"
sysid = 3
link = "udp:192.168.1.33:14550"
guard = "none"
profile = "px4_quad"
offset_m = [-0.6, 0.6, 0.0]
spawn_lab_m = [-0.5, 0.7, 0.0]

[limits]
min_separation_m = 0.45
"""


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    file = tmp_path / "lab.toml"
    file.write_text(LAB)
    return file


def written(lab: Path, text: str) -> str:
    """A scenario beside the lab file."""
    file = lab.with_name("windy.toml")
    file.write_text(text)
    return str(file)


def test_all_of_the_file_is_flown_but_what_is_real(lab: Path) -> None:
    opened, own = find(str(lab)), load_file(lab, LabConfig)
    flown = opened.scenario.lab
    assert (opened.lab_file, opened.lab) == (lab, own)
    assert (flown.mocap.source, flown.mocap.vicon, flown.mocap.names) == ("zenoh", None, {})
    assert flown.followers[0].link is None
    assert flown.operator.stop_button is None
    kept = {"leader": own.leader, "limits": own.limits, "flight": own.flight, "link": own.link, "name": own.name}
    assert {key: getattr(flown, key) for key in kept} == kept
    assert flown.followers[0].profile == "px4_quad"
    assert flown.mocap.q_lab_from_mocap == own.mocap.q_lab_from_mocap
    cameras = opened.scenario.mocap
    assert (cameras.rate_hz, cameras.delay_s) == (200.0, 0.005)
    starts = [opened.scenario.true_vehicle(sysid).start for sysid in (1, 3)]
    assert [start and start.pos_lab_m for start in starts] == [(0.3, 0.2, 0.0), (-0.5, 0.7, 0.0)]


def test_a_scenario_is_a_lab_file_and_a_few_lines(lab: Path) -> None:
    text = 'lab = "lab.toml"\nseed = 4\n[air]\nwind_lab_m_s2 = [0.3, 0.0, 0.0]\n[mocap]\nnoise_m = 0.0005\n'
    scenario = load(written(lab, text + '[[vehicles]]\nsysid = 3\nautopilot = "ardupilot"\n'))
    assert (scenario.name, scenario.seed, scenario.lab) == ("room_7", 4, load(str(lab)).lab)
    assert (scenario.mocap.rate_hz, scenario.mocap.noise_m) == (200.0, 0.0005)
    assert scenario.true_vehicle(1).start == load(str(lab)).true_vehicle(1).start
    assert scenario.true_vehicle(3).autopilot == "ardupilot"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('lab = "nowhere.toml"', "nowhere.toml: No such file"),
        ('lab = "lab.toml"\nsed = 1', "windy.toml: sed: "),
        ('lab = "lab.toml"\n[[vehicles]]\nsysid = 9', "windy.toml: vehicles[0].sysid: sysid 9 is not in the lab"),
        ("seed = 3", "windy.toml: lab: is missing"),
    ],
)
def test_what_is_wrong_is_named_with_its_file(lab: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigError) as raised:
        load(written(lab, text))
    assert message in str(raised.value)


def test_a_lab_file_is_flown_by_the_command_which_says_what_is_simulated(lab: Path, tmp_path: Path) -> None:
    flown = CliRunner().invoke(app, ["run", str(lab), "--json", "--out", str(tmp_path / "out")])
    assert flown.exit_code == 0, flown.output
    summary = json.loads(flown.stdout)
    assert (summary["scenario"], summary["outcome"], summary["followers"]) == ("room_7", "landed", 1)
    assert f"{lab}: simulated drones instead of left at udp:192.168.1.33:14550, " in flown.stderr
    assert "emulated cameras instead of vicon 192.168.1.10, no stop button /dev/input/js7" in flown.stderr
