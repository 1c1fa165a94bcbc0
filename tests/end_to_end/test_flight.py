"""Whole flights by real processes, started as a user starts them."""

import json
import os
import signal
from pathlib import Path

import pytest

from analysis.load import load
from analysis.metrics import summarise
from gcs.replay import replay
from tests.end_to_end.flights import CIRCLE, LINE, gcs_sim_fly, pid_of, processes_of, read_until, write_scenario
from tests.wire.flight import check_log
from wire.logs.mcap_read import read_log

pytestmark = [pytest.mark.processes, pytest.mark.flights, pytest.mark.timeout(900)]


def test_three_drones_fly_the_triangle_and_land(tmp_path: Path) -> None:
    scenario, out = write_scenario(tmp_path, LINE), tmp_path / "run"
    with gcs_sim_fly(str(scenario), "--out", str(out), hosts=2) as process:
        said, _ = process.communicate()
    assert process.returncode == 0, said
    summary = json.loads(summarise(load(out / "flight.mcap")).to_json())
    assert summary["outcome"] == "landed"
    assert summary["link"] == "zenoh"
    assert summary["scenario"] == "short_triangle"
    assert summary["followers"] == 2
    assert summary["formation_rms_m"] <= 0.02
    assert summary["min_separation_m"] > 0.4
    assert summary["latency_ms"]["p50"] < 10.0
    assert 5.0 < summary["age_ms"]["p50"] < 60.0
    page = (out / "report.html").read_text()
    assert "<img" in page or "<svg" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert check_log(out / "flight.mcap").complete
    assert replay(read_log(out / "flight.mcap")).identical
    assert not processes_of(out)


def test_ctrl_c_lands_the_drones_of_one_host_by_udp_and_leaves_no_process_and_a_whole_log(tmp_path: Path) -> None:
    out = tmp_path / "run"
    words = ("--link", "udp", "--out", str(out))
    with gcs_sim_fly(str(write_scenario(tmp_path, CIRCLE)), *words) as process:
        read_until(process, "FORMATION")
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate()
    assert process.returncode == 130, said
    assert "aborted: interrupted" in said
    assert not processes_of(out)
    assert check_log(out / "flight.mcap").complete
    assert replay(read_log(out / "flight.mcap")).identical
    ended = (out / "gcs.log").read_text()
    assert "LAND -> GROUND" in ended


def test_when_an_agent_dies_the_flight_ends_with_its_name_and_leaves_no_process(tmp_path: Path) -> None:
    out = tmp_path / "run"
    with gcs_sim_fly(str(write_scenario(tmp_path, CIRCLE)), "--out", str(out), hosts=None) as process:
        read_until(process, "TAKEOFF")
        os.kill(pid_of(out, lambda words: any(word.endswith("agent-3.toml") for word in words)), signal.SIGKILL)
        said, _ = process.communicate()
    assert process.returncode == 1, said
    assert "agent-3 ended with signal SIGKILL" in said
    assert not processes_of(out)
    assert (out / "report.html").exists()
