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

KEYS = {
    "scenario", "seed", "link", "duration_s", "followers", "formation_rms_m", "formation_max_m", "leader_rms_m",
    "leader_max_m", "vibration_m", "altitude_rms_m", "min_separation_m", "frames", "late_ticks", "law_failures",
    "mocap_ms", "latency_ms", "age_ms", "link_behind_ms", "realtime_factor", "command_hash", "mcap", "report",
    "outcome",
}  # fmt: skip
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


def test_a_run_leaves_log_report_and_a_summary_with_every_key(short_run: Path) -> None:
    summary = json.loads((short_run / "summary.json").read_text())
    assert set(summary) >= KEYS
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
    report = runner.invoke(
        log_app,
        [
            "report",
            str(short_run / "flight.mcap"),
            "--out",
            str(short_run / "r.html"),
            "--json",
        ],
    )
    assert report.exit_code == 0
    again, first = json.loads(report.stdout), json.loads((short_run / "summary.json").read_text())
    assert again["command_hash"] == first["command_hash"]
    assert again["formation_rms_m"] == first["formation_rms_m"]


def test_a_changed_log_is_noticed(short_run: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes((short_run / "flight.mcap").read_bytes()[:-20000])
    runner = CliRunner()
    assert runner.invoke(log_app, ["check", str(cut)]).exit_code == 1
    replayed = runner.invoke(log_app, ["replay", str(cut)])
    assert replayed.exit_code == 0
    assert "bit-identical" in replayed.output
    cut.write_bytes(b"not a log")
    assert runner.invoke(log_app, ["replay", str(cut)]).exit_code == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no poses"),
        (ROW + "2000000000,1.0,2.0\n", "leader.csv:2"),
        (ROW + ROW.replace("1000000000", "900000000"), "leader.csv:2"),
        (ROW + "2000000000,nan,2.0,1.5,1.0,0.0,0.0,0.0\n", "leader.csv:2"),
    ],
)
@pytest.mark.parametrize("command", ["run", "fly"])
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


def test_the_shipped_scenarios_are_listed() -> None:
    code, output = invoke("list")
    assert code == 0
    for name in ("triangle_line", "triangle_circle", "hover_gust", "vicon_leader"):
        assert name in output


def test_a_flight_that_does_not_end_well_ends_with_1(tmp_path: Path) -> None:
    file = tmp_path / "endless.toml"
    file.write_text(dump(load("triangle_line").model_copy(update={"longest_s": 3.0})))
    code, output = invoke("run", str(file), "--out", str(tmp_path))
    assert code == 1
    assert "aborted" in output
