import io
import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from typer.testing import CliRunner

from formation.config import FollowerConfig, LabConfig, LeaderConfig, MocapConfig
from formation.control.margin import delay_margin
from formation.control.presets import preset_for
from formation.messages import Verb
from formation.vehicle.profile import PX4_QUAD, GainScale
from gcs.cli.app import app
from gcs.cli.operator import next_steps, print_status
from gcs.lab.margins import judge_margins
from tests.free_ports import free_port
from tests.gcs.fakes import FakeLab, triangle
from wire import clock
from wire.logs.mcap_log import check_log

runner = CliRunner()
PATIENT = ("--timeout", "500")
LAB = """
name = "{name}"
[mocap]
source = "csv"
file = "{csv}"
[leader]
body = "lead"
[[followers]]
body = "left"
sysid = 2
offset_m = [0.0, 1.0, 0.0]
[link]
zenoh_connect = ["tcp/127.0.0.1:{port}"]
{listen}
"""


def _lab(tmp_path: Path, listen: bool = False, csv: str = "", port: int | None = None) -> Path:
    port = port or free_port()
    text = LAB.format(
        name=f"cli-{os.getpid()}",
        csv=csv or tmp_path / "leader.csv",
        port=port,
        listen=f'zenoh_listen = ["tcp/127.0.0.1:{port}"]' if listen else "",
    )
    path = tmp_path / ("ground.toml" if listen else "lab.toml")
    path.write_text(text)
    return path


def test_help_names_every_command_and_the_exit_codes():
    shown = " ".join(runner.invoke(app, ["--help"]).output.split())
    for name in ("run", "rules", "doctor", "logs", *(verb.command_name for verb in Verb)):
        assert name in shown
    assert "no ground answers" in shown


def test_a_lab_file_that_is_not_right_is_named_with_its_key(tmp_path):
    lab = tmp_path / "lab.toml"
    lab.write_text("[leader]\nbody = 'lead'\nspeed_kmh = 3\n[[followers]]\nbody='l'\nsysid=2\noffset_m=[0,1,0]\n")
    result = runner.invoke(app, ["run", str(lab)])
    assert result.exit_code == 2
    assert "lab.toml" in result.output
    assert "speed_kmh" in result.output


def test_a_lab_file_that_is_missing():
    result = runner.invoke(app, ["run", "/nowhere/lab.toml"])
    assert result.exit_code == 2
    assert "/nowhere/lab.toml" in result.output


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (("sysid = 2", 'sysid = 2\nlink = "tcp:1"'), "followers[0].link (left): not udp:HOST:PORT"),
        (("offset_m", "# offset_m"), "followers[0].offset_m (left): is missing"),
        (('file = "', '# "'), 'mocap.file: is missing: source "csv" needs `file`'),
        (('zenoh_connect = ["tcp/', 'zenoh_connect = ["'), "link.zenoh_connect[0]: not an endpoint"),
        (("sysid = 2", "sysid = 251"), "followers[0].sysid (left): "),
        (
            ('body = "left"', 'body = "lead"'),
            "followers[0].body (lead): leader has it, too: two vehicles share a body name",
        ),
    ],
)
def test_a_wrong_value_is_named_with_file_and_key(tmp_path, wrong, words):
    lab = _lab(tmp_path)
    lab.write_text(lab.read_text().replace(*wrong))
    for command in ("run", "doctor", "logs"):
        result = runner.invoke(app, [command, str(lab)])
        assert result.exit_code == 2
        assert result.output.startswith(f"gcs: {lab}:")
        assert words in result.output
        assert len(result.output.splitlines()) == 1


@pytest.mark.parametrize(
    "options",
    [["arm", "--timeout", "-1"], ["doctor", "lab.toml", "--seconds", "-1"], ["run", "lab.toml", "--tag", "x"]],
)
def test_an_option_out_of_range_is_exit_code_two(tmp_path, monkeypatch, options):
    _lab(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert runner.invoke(app, options).exit_code == 2


def test_a_recording_that_is_not_right_is_exit_code_two(tmp_path, capfd):
    csv = tmp_path / "leader.csv"
    csv.write_text("1,0,0,0,1,0,0,0\n2,0,0,nan,1,0,0,0\n")
    result = runner.invoke(app, ["run", str(_lab(tmp_path)), "--log", str(tmp_path / "x.mcap")])
    assert result.exit_code == 2
    assert f"{csv}:2: column 4 (z) = nan: a value is not finite" in capfd.readouterr().err  # the mocap process says it


def test_the_gains_that_are_judged_are_those_the_lab_flies():
    slow = PX4_QUAD.model_copy(update={"name": "ours", "gain_scale": GainScale(horizontal=0.5, observer=0.5)})
    leader = LeaderConfig(body="lead", sysid=1, profile="ours")
    follower = FollowerConfig(body="left", sysid=2, profile="ours", offset_m=(0.0, 1.0, 0.0))
    config = LabConfig(profiles=(slow,), leader=leader, followers=(follower,))
    assert judge_margins(config) == []
    late = slow.model_copy(update={"response_lag_s": 50.0})
    (found,) = judge_margins(config.model_copy(update={"profiles": (late,)}))
    margin = delay_margin(late, preset_for("default", late, config.mocap), config.mocap)
    assert (found.subject, found.found) == ("profiles[0].response_lag_s", "50")
    assert str(margin) in found.why


def test_a_preset_that_the_vehicles_lag_cannot_carry_is_rejected_with_the_numbers(tmp_path):
    lab = _lab(tmp_path)
    text = lab.read_text().replace("sysid = 2", 'sysid = 2\nprofile = "px4_quad"')
    lab.write_text('control_preset = "paper"\n' + text)
    result = runner.invoke(app, ["run", str(lab)])
    assert result.exit_code == 1
    margin = delay_margin(PX4_QUAD, preset_for("paper", PX4_QUAD, MocapConfig()), MocapConfig())
    assert margin.margin_s < margin.needed_s == pytest.approx(0.0178)
    assert str(margin) in result.output
    assert "--force" in result.output


def test_an_unknown_preset_names_the_known_ones(tmp_path):
    lab = _lab(tmp_path)
    lab.write_text('control_preset = "heroic"\n' + lab.read_text())
    result = runner.invoke(app, ["run", str(lab)])
    assert result.exit_code == 2
    assert "heroic" in result.output
    assert "default, pid_leader, paper" in result.output


def test_no_ground_is_exit_code_three(tmp_path):
    result = runner.invoke(app, ["status", "--lab", str(_lab(tmp_path)), "--timeout", "0.2"])
    assert result.exit_code == 3
    assert "no ground answers" in result.output


def test_the_rules_are_printed():
    shown = runner.invoke(app, ["rules"]).output
    assert "| FORMATION |" in shown
    assert "outside the fence" in shown


def _gcs(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "gcs", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _status_once_it_sees(lab: str) -> dict[str, Any]:
    """What the ground answers once it has had a frame: on a busy machine it answers long before."""
    end_ns = clock.monotonic_ns() + 120_000_000_000
    while clock.monotonic_ns() < end_ns:
        told = _gcs("status", "--lab", lab, "--json", *PATIENT)
        assert told.returncode == 0, told.stderr
        status: dict[str, Any] = json.loads(told.stdout)
        if status["counters"]["frames"] > 0:
            return status
    raise AssertionError("the ground never saw a frame")


@pytest.mark.processes
def test_a_ground_answers_other_processes_and_ends_on_a_signal(tmp_path):
    csv = tmp_path / "leader.csv"
    csv.write_text("".join(f"{i * 10_000_000},0,0,1,1,0,0,0\n" for i in range(10_000)))
    log, port = tmp_path / "flight.mcap", free_port()
    lab, own = str(_lab(tmp_path, port=port)), str(_lab(tmp_path, listen=True, port=port))
    command = [sys.executable, "-m", "gcs", "run", own, "--log", str(log), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as ground:
        try:
            assert _status_once_it_sees(lab)["phase"] == "GROUND"
            assert "GROUND" in _gcs("status", "--lab", lab, *PATIENT).stdout
            refused = _gcs("arm", "--lab", lab, *PATIENT)
            assert refused.returncode == 1
            assert "left: no heartbeat (last heard never)" in refused.stderr
            refused = _gcs("shape", "heptagon", "--lab", lab, "--json", *PATIENT)
            assert (refused.returncode, json.loads(refused.stdout)["accepted"]) == (1, False)
            assert _gcs("stop", "--lab", lab, *PATIENT).returncode == 0
            ground.send_signal(signal.SIGINT)
            output, _ = ground.communicate()
            assert ground.returncode == 0
            assert json.loads(output.splitlines()[-1])["phase"] == "STOPPED"
            assert check_log(log).complete
        finally:
            ground.kill()


def test_status_shows_every_column_in_80_characters_whatever_the_names():
    lab = FakeLab(triangle())
    lab.run(2.0)
    state = lab.core.state(lab.now_ns) | {"not_landed": ["right"]}
    far = {"body": "a-follower-with-a-long-name-12", "autopilot": "ArduPilot", "mode": "OFFBOARD", "armed": True}
    state["drones"][1] |= far | {"pos_lab_m": [-12.34, -10.56, -0.12], "battery": 1.0, "link_behind_s": 0.064}
    out = io.StringIO()
    print_status(state, Console(file=out, width=80))
    (row,) = (line.split() for line in out.getvalue().splitlines() if line.startswith("2 "))
    assert row[2:-2] == ["ArduPilot", "OFFBOARD", "armed", "-12.34", "-10.56", "-0.12", "100", "64"]
    assert "\u2026" not in out.getvalue()
    assert "not known to have landed: right" in out.getvalue()


def test_status_says_what_may_be_asked_next():
    assert next_steps("ARMED", {"takeoff": [], "land": [], "stop": [], "arm": ["arm is for GROUND"]}) == [
        "next: gcs takeoff, gcs land"
    ]
    assert next_steps("STOPPED", {"land": [], "reset": []}) == ["next: gcs reset"]
    assert next_steps("STOPPED", {"land": [], "reset": ["left: armed"]}) == ["no reset: left: armed"]
