"""`gcs check`: what it prints, draws and exits with; and that `gcs run` refuses the same."""

import json
import re
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from typer.testing import CliRunner

from formation.codes import FlightResult
from formation.config import LabConfig
from formation.vehicle.profile import PROFILES
from gcs.cli.app import app
from gcs.finding import Finding, Grade
from gcs.lab.judge import judge
from gcs.lab.new import SOURCES, lab_text
from sim import lockstep
from sim.scenario import load
from wire.config_file import parse

runner = CliRunner()
SVG = "{http://www.w3.org/2000/svg}"
LAB = """
name = "room"
[leader]
body = "leader"
sysid = 1
trajectory = { kind = "circle", radius_m = 0.5, period_s = 10.0, laps = 3 }
[[followers]]
body = "right"
sysid = 2
offset_m = [-0.4, -0.4, 0.0]
"""


def written(folder: Path, *changes: tuple[str, str], more: str = "") -> Path:
    text = LAB
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "lab.toml"
    path.write_text(text + more)
    return path


def test_a_good_lab_is_drawn_and_told_in_numbers(tmp_path: Path) -> None:
    lab = written(tmp_path, ("sysid = 2", 'sysid = 2\nprofile = "crazyflie_27g"'))
    result = runner.invoke(app, ["check", str(lab)])
    assert result.exit_code == 0
    assert "circle: 9.42 m in 32.5 s" in result.output
    # 0.314 m/s round the circle; half-way through the ramp 1.875 * 0.314 / 2.5 s along it, 0.157^2 / 0.5 across it.
    assert "leader: up to 0.31 m/s and 0.24 m/s^2" in result.output
    assert "fastest slot, right: up to 0.31 m/s" in result.output
    assert "flies as crazyflie_27g: 27 g, 92 mm, hovers at 0.58" in result.output
    assert "flies as paper_40g: 40 g, 120 mm, hovers at 0.61 (none named)" in result.output
    assert all(len(line) <= 80 and line.isascii() for line in result.output.splitlines()[:-1] if str(lab) not in line)
    numbers = json.loads(runner.invoke(app, ["check", str(lab), "--json"]).stdout)["numbers"]
    assert numbers["duration_s"] == 32.5
    assert numbers["length_m"] == pytest.approx(3 * 2 * np.pi * 0.5, rel=1e-3)
    assert sorted(v["profile"] for v in numbers["vehicles"].values()) == ["crazyflie_27g", "paper_40g"]
    assert "leader: no profile is named, and each is flown as paper_40g, a vehicle of 40 g" in result.output
    named = (("sysid = 1", 'sysid = 1\nprofile = "paper_40g"'), ("sysid = 2", 'sysid = 2\nprofile = "paper_40g"'))
    good = runner.invoke(app, ["check", str(written(tmp_path, *named))])
    assert good.output.endswith(": no errors, no warnings\n")


def test_errors_come_first_each_at_its_line_and_as_json(tmp_path: Path) -> None:
    lab = written(tmp_path, ("radius_m = 0.5", "radius_m = 30.0"), more="[flight]\naltitude_m = 0.1\n")
    result = runner.invoke(app, ["check", str(lab)])
    assert result.exit_code == 1
    lines = result.output.splitlines()
    kinds = [line.partition(":")[0] for line in lines if line.startswith(("error:", "warning:"))]
    assert kinds == sorted(kinds)
    assert any(line.startswith(f"error: {lab}:6 leader.trajectory.radius_m = 30: ") for line in lines)
    assert any(line.startswith(f"warning: {lab}:12 flight.altitude_m = 0.1: ") for line in lines)
    assert lines[-1] == f"{lab}: 3 errors, 2 warnings"
    (finding, *_) = json.loads(runner.invoke(app, ["check", str(lab), "--json"]).stdout)["findings"]
    assert (finding["subject"], finding["found"], finding["grade"]) == ("leader.trajectory.radius_m", "30", "fail")


def test_a_fault_of_one_field_is_a_finding_too(tmp_path: Path) -> None:
    lab = written(tmp_path, more="[mocap]\nq_lab_from_mocap = [1, 1, 0, 0]\nrate = 3\n")
    result = runner.invoke(app, ["check", str(lab)])
    assert result.exit_code == 1
    assert f"error: {lab}:12 mocap.q_lab_from_mocap = [1, 1, 0, 0]: not a rotation" in result.output
    assert f"error: {lab}:13 mocap.rate: is not a known key" in result.output


def test_what_the_ground_would_refuse_for_its_delay_fails_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = Finding("control_preset", "delay", Grade.FAIL, "", why="would not fly steadily")
    monkeypatch.setattr("gcs.lab.cli.judge_margins", lambda _config: [found])
    result = runner.invoke(app, ["check", str(written(tmp_path))])
    assert result.exit_code == 1
    assert "control_preset: would not fly steadily" in result.output


def test_what_is_no_lab_file_is_exit_code_two(tmp_path: Path) -> None:
    assert runner.invoke(app, ["check", "/nowhere/lab.toml"]).exit_code == 2
    result = runner.invoke(app, ["check", str(written(tmp_path, ("sysid = 1", "sysid = 1,0"))), "--json"])
    assert result.exit_code == 2
    assert "line 5" in json.loads(result.stdout)["error"]


def test_the_ground_rejects_the_same_at_its_start(tmp_path: Path) -> None:
    lab, log = written(tmp_path, ("[-0.4, -0.4, 0.0]", "[-400.0, -0.4, 0.0]")), tmp_path / "x.mcap"
    result = runner.invoke(app, ["run", str(lab), "--log", str(log)])
    assert result.exit_code == 2
    assert f"gcs: {lab}:10 followers[0].offset_m (right) = [-400, -0.4, 0]: the slot of right is at" in result.stderr
    assert not log.exists()


def test_an_emergency_stop_is_not_kept_waiting_by_a_lab_that_is_rejected(tmp_path: Path) -> None:
    lab = written(tmp_path, ("radius_m = 0.5", "radius_m = 30.0"), more='[link]\nzenoh_connect=["tcp/127.0.0.1:9"]\n')
    result = runner.invoke(app, ["stop", "--lab", str(lab), "--timeout", "0.1"])
    assert result.exit_code == 3, "it asks, and no ground answers"


def size(group: ElementTree.Element) -> tuple[float, float]:
    """Width and height of a drawn path, in the sheet's units."""
    numbers = re.findall(r"-?\d+\.?\d*", group.find(f"{SVG}path").get("d", ""))
    at = np.array(numbers, float).reshape(-1, 2)
    return tuple(np.ptp(at, axis=0))


def test_the_svg_is_to_scale_and_what_leaves_the_fence_is_drawn_as_plain_as_the_fence(tmp_path: Path) -> None:
    """A circle of 1.7 m carries a slot 0.4 m to the right 0.1 m out of a fence 2 m to the right: one arc of it."""
    svg = tmp_path / "lab.svg"
    lab = written(tmp_path, ("radius_m = 0.5", "radius_m = 1.7"), ("laps = 3", "laps = 1"))
    assert runner.invoke(app, ["check", str(lab), "--svg", str(svg)]).exit_code == 1
    root, config = ElementTree.parse(svg).getroot(), load(str(lab)).lab
    (low_x, low_y, _), (high_x, high_y, _) = config.limits.fence.low_m, config.limits.fence.high_m
    groups = {group.get("id"): group for group in root.iter(f"{SVG}g")}
    wide, high = size(groups["fence"])
    assert wide / high == pytest.approx((high_y - low_y) / (high_x - low_x), rel=1e-3)
    across = config.limits.min_separation_m / (high_y - low_y) * wide
    for body in ("leader", "right"):
        assert size(groups[f"at-{body}"]) == pytest.approx((across, across), rel=1e-2)
    assert len([group for group in root.iter(f"{SVG}g") if group.get("id") == "outside"]) == 1
    shown = {text.text for text in root.iter(f"{SVG}text")}
    assert {config.name, "leader", "right", "x forward, m", "y left, m", "fence", "slots' paths"} <= shown


def test_a_scenario_is_judged_and_its_lab_file_drawn(tmp_path: Path) -> None:
    scenario = tmp_path / "short.toml"
    scenario.write_text('lab = "lab.toml"\n')
    result = runner.invoke(app, ["check", str(scenario), "--svg", str(tmp_path / "x.svg")])
    assert (result.exit_code, "what is drawn is a lab file" in result.output) == (2, True)


@pytest.mark.parametrize("source", SOURCES)
@pytest.mark.parametrize("kind", PROFILES)
@pytest.mark.parametrize("followers", [1, 3, 20])
def test_a_new_lab_file_is_accepted(source: str, kind: str, followers: int) -> None:
    config = parse(tomllib.loads(lab_text(source, followers, PROFILES[kind])), LabConfig, source="new")
    assert [finding for finding in judge(config) if finding.grade is Grade.FAIL] == []
    assert {finding.subject for finding in judge(config)} <= {"formation.spacing_m"}  # a shape for another room
    assert (config.mocap.source, len(config.followers)) == (source, followers)


def test_a_new_lab_file_is_written_once_and_flies(tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    asked = ["new", str(lab), "--source", "vicon", "--followers", "3"]
    assert runner.invoke(app, asked).exit_code == 0
    written = lab.read_text()
    again = runner.invoke(app, [*asked, "--followers", "1"])
    assert (again.exit_code, lab.read_text()) == (2, written)
    assert "lab.toml: it is there already: --overwrite writes over it" in again.output
    flown, _ = lockstep.run_in_memory(load(str(lab)), 1)
    assert flown.outcome.result is FlightResult.LANDED
    wrong = runner.invoke(app, ["new", str(tmp_path / "other.toml"), "--source", "optitrack"])
    assert wrong.exit_code == 2
    assert "natnet" in wrong.output
