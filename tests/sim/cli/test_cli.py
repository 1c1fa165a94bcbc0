import json
import os
from errno import ENOSPC
from pathlib import Path

import pytest
from typer.testing import CliRunner

from sim.cli.app import app
from sim.cli.log import app as log_app
from sim.scenario import load
from wire.config_file import dump

ROW = "1000000000,1.0,2.0,1.5,1.0,0.0,0.0,0.0\n"


def invoke(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def short_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A line of 2 s, flown by the command, which misses what is required; the summary and its words beside the log."""
    folder = tmp_path_factory.mktemp("run")
    scenario = load("triangle_line")
    trajectory = scenario.lab.leader.trajectory.model_copy(update={"length_m": 0.2, "duration_s": 2.0})
    lab = scenario.lab.model_copy(update={"leader": scenario.lab.leader.model_copy(update={"trajectory": trajectory})})
    file = folder / "short.toml"
    file.write_text(dump(scenario.model_copy(update={"name": "short", "lab": lab})))
    required = ("--require", "formation_rms_m<0.05", "--require", "frames<10")
    flown = CliRunner().invoke(app, ["run", str(file), "--seed", "4", "--out", str(folder), "--json", *required])
    assert flown.exit_code == 1, flown.output
    (folder / "summary.json").write_text(flown.stdout)
    (folder / "told.txt").write_text(flown.stderr)
    return folder


def test_a_run_leaves_log_report_and_a_summary(short_run: Path) -> None:
    summary = json.loads((short_run / "summary.json").read_text())
    assert (summary["scenario"], summary["seed"], summary["followers"]) == ("short", 4, 2)
    assert summary["outcome"] == "landed"
    assert summary["realtime_factor"] > 0.0
    assert summary["age_ms"] is None
    assert summary["mcap"] == str(short_run / "flight.mcap")
    assert (short_run / "report.html").read_text().startswith("<!doctype html>")


def test_a_flight_that_misses_what_is_required_says_what_and_ends_with_code_1(short_run: Path) -> None:
    frames = json.loads((short_run / "summary.json").read_text())["frames"]
    told = (short_run / "told.txt").read_text()
    assert f"frames<10 is required, it is {frames}" in told
    assert "formation_rms_m" not in told
    assert invoke("run", str(short_run / "short.toml"), "--require", "frames!10")[0] == 2


def test_the_log_says_the_same_again(short_run: Path) -> None:
    runner = CliRunner()
    replayed = runner.invoke(log_app, ["replay", str(short_run / "flight.mcap"), "--json"])
    assert replayed.exit_code == 0
    told = json.loads(replayed.stdout)
    assert told["identical"] is True
    assert told["difference"] is None
    report = runner.invoke(log_app, ["report", str(short_run / "flight.mcap"), "--json"])
    assert report.exit_code == 0
    again, first = json.loads(report.stdout), json.loads((short_run / "summary.json").read_text())
    assert again["command_hash"] == first["command_hash"]
    assert again["formation_rms_m"] == first["formation_rms_m"]


@pytest.mark.parametrize(
    ("command", "text", "said"),
    [
        ("run", "", "no line of numbers in this file"),
        ("run", ROW + ROW.replace("1000000000", "900000000"), "leader.csv:2"),
        ("fly", ROW + "2000000000,1.0,2.0\n", "leader.csv:2"),
    ],
)
def test_a_recording_that_is_not_right_is_refused_with_file_and_line(
    command: str, text: str, said: str, tmp_path: Path
) -> None:
    file = tmp_path / "leader.csv"
    file.write_text(text)
    code, output = invoke(command, "vicon_leader", "--leader-csv", str(file), "--out", str(tmp_path / "run"))
    assert code == 2
    assert said in output
    assert str(file) in output
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "triangle_lane"), "triangle_line"),
        (("run", "vicon_leader"), "--leader-csv"),
        (("run", "triangle_line", "--leader-alignment", "1,0,0,0"), "sysid 1"),
        (("run", "vicon_leader", "--leader-alignment", "1,0,0"), "four numbers"),
        (("run", "vicon_leader", "--leader-alignment", "1,1,0,0"), "length"),
        (("fly", "triangle_line", "--link", "carrier-pigeon"), "carrier-pigeon"),
    ],
)
def test_what_is_not_right_is_said_and_ends_with_2(arguments: tuple[str, ...], said: str) -> None:
    code, output = invoke(*arguments)
    assert code == 2
    assert said in output


def test_a_disk_without_room_is_said_before_the_flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(ENOSPC, os.strerror(ENOSPC))

    monkeypatch.setattr("os.posix_fallocate", full)
    code, said = invoke("run", "triangle_line", "--out", str(tmp_path))
    assert (code, said) == (2, f"gcs-sim: {tmp_path}: no flight can be recorded here: {os.strerror(ENOSPC)}\n")
