import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from typer.testing import CliRunner

from formation.clock_pair import ClockPair
from formation.config import MocapConfig
from formation.control.margin import delay_margin
from formation.control.presets import preset_for
from formation.messages import Phase, Verb
from formation.vehicle.profile import PX4_QUAD
from gcs.cli.app import app
from gcs.cli.operator import begin_unix_s, next_steps
from gcs.daemon import on_own_clock
from tests.free_ports import free_port
from tests.wire.flight import check_log

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


@pytest.mark.parametrize(
    ("wrong", "key", "reason"),
    [
        (("offset_m", "# offset_m"), "followers[0].offset_m", "is missing"),
        (('name = "cli', 'control_preset = "heroic"\nname = "cli'), "control_preset", "default, pid_leader, paper"),
    ],
)
def test_a_wrong_value_is_named_with_file_and_key(tmp_path, wrong, key, reason):
    lab = _lab(tmp_path)
    lab.write_text(lab.read_text().replace(*wrong))
    for command in ("run", "doctor", "logs"):
        result = runner.invoke(app, [command, str(lab)])
        assert result.exit_code == 2
        assert result.output.startswith(f"gcs: {lab}:")
        assert f" {key}" in result.output
        assert reason in result.output
        assert len(result.output.splitlines()) == 1


@pytest.mark.parametrize(
    "options",
    [
        ["arm", "--timeout", "-1"],
        ["start", "--at", "noon"],
        ["start", "--at", "+soon"],
        ["run", "lab.toml", "--tag", "x"],
        ["run", "/nowhere/lab.toml"],
    ],
)
def test_an_option_out_of_range_is_exit_code_two(tmp_path, monkeypatch, options):
    _lab(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert runner.invoke(app, options).exit_code == 2


def test_a_preset_that_the_vehicles_lag_cannot_carry_is_rejected_with_the_numbers(tmp_path):
    lab = _lab(tmp_path)
    text = lab.read_text().replace("sysid = 2", 'sysid = 2\nprofile = "px4_quad"')
    lab.write_text('control_preset = "paper"\n' + text + "\n[limits]\nmin_separation_m = 0.45\n")
    result = runner.invoke(app, ["run", str(lab)])
    assert result.exit_code == 1
    margin = delay_margin(PX4_QUAD, preset_for("paper", PX4_QUAD, MocapConfig()), MocapConfig())
    assert margin.margin_s < margin.needed_s == pytest.approx(0.0178)
    assert str(margin) in result.output
    assert "--force" in result.output


@pytest.mark.processes
def test_a_ground_answers_other_processes_and_ends_on_a_signal(tmp_path):
    csv = tmp_path / "leader.csv"
    csv.write_text("".join(f"{i * 10_000_000},0,0,1,1,0,0,0\n" for i in range(10_000)))
    log, port = tmp_path / "flight.mcap", free_port()
    lab, own = str(_lab(tmp_path, port=port)), str(_lab(tmp_path, listen=True, port=port))

    def gcs(*words: str) -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", "gcs", *words, "--lab", lab, *PATIENT]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    command = [sys.executable, "-m", "gcs", "run", own, "--log", str(log), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as ground:
        try:
            while (status := json.loads(gcs("status", "--json").stdout))["counters"]["frames"] == 0:
                pass  # on a busy machine it answers long before it sees
            assert status["phase"] == "GROUND"
            refused = gcs("arm")
            assert refused.returncode == 1
            assert "left: no heartbeat (last heard never)" in refused.stderr
            refused = gcs("shape", "heptagon", "--json")
            assert (refused.returncode, json.loads(refused.stdout)["accepted"]) == (1, False)
            assert gcs("stop").returncode == 0
            ground.send_signal(signal.SIGINT)
            output, _ = ground.communicate()
            assert ground.returncode == 0
            assert json.loads(output.splitlines()[-1])["phase"] == "STOPPED"
            assert check_log(log).complete
        finally:
            ground.kill()


def test_status_says_what_may_be_asked_next():
    out_of_turn = {verb: ["out of turn"] for verb in Verb}
    assert next_steps(Phase.ARMED, out_of_turn | {Verb.TAKEOFF: [], Verb.LAND: []}) == ["next: gcs takeoff, gcs land"]
    assert next_steps(Phase.STOPPED, out_of_turn | {Verb.RESET: []}) == ["next: gcs reset"]
    assert next_steps(Phase.STOPPED, out_of_turn | {Verb.RESET: ["left: armed"]}) == ["no reset: left: armed"]


def test_a_time_to_begin_is_of_today_or_from_now_or_a_date() -> None:
    now_s = time.time()
    assert begin_unix_s("+20") == pytest.approx(now_s + 20.0, abs=1.0)
    today = time.strftime("%Y-%m-%d")
    assert begin_unix_s("14:30:00.5") == begin_unix_s(f"{today}T14:30:00.5")
    assert begin_unix_s("2026-11-27T14:30:00Z") == 1_795_789_800.0


def test_a_date_is_put_on_the_ground_s_own_clock_and_what_is_none_stays() -> None:
    pair = ClockPair(5_000_000_000, 1_795_789_800_000_000_000)
    assert on_own_clock("1795789820000000000", pair) == "25000000000"
    assert on_own_clock("soon", pair) == "soon"
