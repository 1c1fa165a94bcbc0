"""The triangle with each camera system's own protocol in the loop, over real sockets, in a turned room."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.load import load
from analysis.metrics import summarise
from formation import topics
from formation.messages import Phase
from tests.end_to_end.flights import CIRCLE, LINE, RATE_HZ, UPSIDE_DOWN, gcs_sim_fly, write_scenario
from wire.logs.mcap_log import read_log

pytestmark = [pytest.mark.processes, pytest.mark.flights, pytest.mark.timeout(900)]

WORSE = 1.5
"""A sanity bound: a wrong axis, unit or sign costs a hundred times that, a busy machine's timing a fifth."""
AWAY_S, BACK_S = 1.5, 2.0
"""How long the server is gone, and how soon after it the frames are to be back."""
TURNED = """
source = "{source}"
axes = ["x right", "y up", "z back"]
origin_lab_m = [0.3, -0.2, 0.1]
unit = "mm"
names = {{ "{leader}" = "leader" }}
"""


def flown(scenario: Path, out: Path, *arguments: str) -> dict[str, Any]:
    with gcs_sim_fly(str(scenario), *arguments, "--out", str(out)) as process:
        said, _ = process.communicate()
    assert process.returncode == 0, said
    summary: dict[str, Any] = json.loads(summarise(load(out / "flight.mcap")).to_json())
    assert summary["outcome"] == "landed"
    return summary


@pytest.fixture(scope="module")
def plain_m(tmp_path_factory: pytest.TempPathFactory) -> float:
    """The formation error of the same flight with poses from the bus."""
    folder = tmp_path_factory.mktemp("plain")
    error_m: float = flown(write_scenario(folder, LINE), folder / "run")["formation_rms_m"]
    return error_m


@pytest.mark.parametrize(
    ("protocol", "source"),
    [("vrpn", "vrpn"), ("chingmu", "chingmu"), ("natnet", "natnet"), ("qtm", "qualisys"), ("vicon", "vicon")],
)
def test_a_turned_room_in_millimetres_flies_as_the_plain_one(
    protocol: str, source: str, plain_m: float, tmp_path: Path
) -> None:
    scenario = write_scenario(
        tmp_path, LINE, TURNED.format(source=source, leader="307" if source == "chingmu" else "Quad 1"), UPSIDE_DOWN
    )
    summary = flown(scenario, tmp_path / "run", "--mocap", protocol)
    assert summary["formation_rms_m"] <= WORSE * plain_m


OWN_LAB = """
mocap = {{ source = "vicon", {rate}, axes = ["x right", "y up", "z back"], names = {{ "Quad 1" = "leader" }}, {host} }}
leader = {{ body = "leader", sysid = 1, trajectory = {{ {trajectory} }} }}
followers = [{{ body = "left", sysid = 3, link = "udp:192.168.1.33:14550", {profile}, offset_m = [-0.5, 0.5, 0.0] }}]
"""


def test_a_labs_own_file_flies_by_its_cameras_protocol(tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    host, rate, profile = 'vicon = { host = "192.168.1.10" }', f"rate_hz = {RATE_HZ}", 'profile = "paper_40g"'
    lab.write_text(OWN_LAB.format(host=host, rate=rate, profile=profile, trajectory=LINE))
    summary = flown(lab, tmp_path / "run", "--mocap", "vicon")
    assert (summary["scenario"], summary["followers"]) == ("lab", 1)


@pytest.mark.parametrize("protocol", ["natnet", "vicon"])
def test_a_server_that_is_gone_for_a_while_makes_them_hold_then_land_and_the_landing_ends_on_mocap(
    protocol: str, tmp_path: Path
) -> None:
    gone = f"[{{ at_s = 1.5, for_s = {AWAY_S} }}]"
    with gcs_sim_fly(
        str(write_scenario(tmp_path, CIRCLE, gaps=gone)), "--mocap", protocol, "--out", str(tmp_path / "run")
    ) as process:
        process.communicate()
    log = read_log(tmp_path / "run" / "flight.mcap")
    frames = [(entry.t_ns, entry.message) for entry in log.entries if entry.topic is topics.MOCAP]
    changes = [(entry.t_ns, entry.message) for entry in log.entries if entry.topic is topics.PHASE]
    formed_ns = next(t_ns for t_ns, change in changes if change.phase is Phase.FORMATION)
    captured = np.array([frame.t_capture_ns for _, frame in frames if frame.seen.all()])
    in_formation = captured[captured > formed_ns]
    dark = int(np.argmax(np.diff(in_formation)))
    last_ns, back_ns = in_formation[dark], in_formation[dark + 1]
    assert AWAY_S < (back_ns - last_ns) * 1e-9 < AWAY_S + BACK_S
    held_s, landed_s = (
        (next(t_ns for t_ns, change in changes if t_ns > last_ns and change.phase is phase) - last_ns) * 1e-9
        for phase in (Phase.HOLD, Phase.LAND)
    )
    assert 0.2 <= held_s < 0.4
    assert 0.4 <= landed_s < 0.6
    assert changes[-1][1].phase is Phase.GROUND
    assert captured[-1] > changes[-1][0] - 500_000_000
