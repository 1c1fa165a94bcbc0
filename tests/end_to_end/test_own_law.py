"""A lab's own law that never answers, in a flight of real processes: the built-in law flies on, which is told."""

import json
from pathlib import Path

import pytest

from gcs.replay import replay
from tests.end_to_end.flights import CIRCLE, gcs_sim_fly
from wire.logs.mcap_log import read_log

pytestmark = [pytest.mark.processes, pytest.mark.flights, pytest.mark.timeout(900)]
PACKAGE = """
class Loops:
    asked = 0

    def __call__(self, at):
        self.asked += 1
        while self.asked > 50:
            try:
                self.asked += 1
            except Exception:
                pass
        away_m, away_m_s = at.slot.pos_lab_m - at.own.pos_lab_m, at.slot.vel_lab_m_s - at.own.vel_lab_m_s
        return at.slot.acc_lab_m_s2 + 4.0 * away_m + 3.0 * away_m_s
"""
LAB = """
control_law = {{ name = "loops" }}
leader = {{ body = "leader", sysid = 1, trajectory = {{ {trajectory} }} }}
followers = [{{ body = "left", sysid = 3, offset_m = [-0.5, 0.5, 0.0] }}]
"""


def test_a_law_that_loops_stops_neither_the_ground_nor_the_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = tmp_path / "site" / "looping-1.0.dist-info"
    told.mkdir(parents=True)
    (told / "METADATA").write_text("Metadata-Version: 2.1\nName: looping\nVersion: 1.0\n")
    (told / "entry_points.txt").write_text("[mavlink_formation.control_laws]\nloops = looping:Loops\n")
    (told.parent / "looping.py").write_text(PACKAGE)
    monkeypatch.setenv("PYTHONPATH", str(told.parent))
    lab = tmp_path / "lab.toml"
    lab.write_text(LAB.format(trajectory=CIRCLE.replace("duration_s = 60.0", "laps = 1")))
    with gcs_sim_fly(str(lab), "--json", "--out", str(tmp_path / "run")) as process:
        said, _ = process.communicate()
    assert process.returncode == 1, said
    summary, _ = json.JSONDecoder().raw_decode(said, said.index("{\n"))  # the outcome follows on standard error
    assert summary["outcome"] == "law failed: control law loops: no answer within 10 ms; the built-in law flies on"
    assert summary["law_failures"] == 1
    assert summary["formation_rms_m"] < 0.01
    monkeypatch.syspath_prepend(told.parent)
    assert replay(read_log(tmp_path / "run" / "flight.mcap")).identical
