"""A new lab to a signed flight by real processes, as a user starts them: keys, then the flight, then the audit."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import tomli_w
from typer.testing import CliRunner

from formation import topics
from gcs.replay import replay
from sim.cli.log import app as log_app
from tests.end_to_end.flights import gcs_sim_fly
from wire.logs.mcap_read import read_log

pytestmark = [pytest.mark.processes, pytest.mark.flights, pytest.mark.timeout(900)]
LAB = {
    "name": "lab",
    "leader": {
        "body": "leader", "sysid": 1,
        "trajectory": {"kind": "line", "length_m": 0.5, "duration_s": 2.0},
    },
    "followers": [{"body": "right", "sysid": 2, "offset_m": [-0.4, -0.4, 0.0]}],
    "security": {},
}  # fmt: skip
SIGNED = 0x01


def test_a_new_lab_flies_signed(tmp_path: Path) -> None:
    lab, out = tmp_path / "lab.toml", tmp_path / "run"
    lab.write_text(tomli_w.dumps(LAB))
    subprocess.run([sys.executable, "-m", "gcs", "keys", "new", str(lab)], check=True, capture_output=True)
    with gcs_sim_fly(str(lab), "--signed", "--out", str(out), hosts=None) as process:
        said, _ = process.communicate()
    assert process.returncode == 0, said
    log = read_log(out / "flight.mcap")
    up = [entry.message.data for entry in log.entries if entry.topic == topics.LINK_UP]
    assert len(up) > 500
    assert all(data[0] == 0xFD and data[2] == SIGNED for data in up)
    assert log.metadata["security"] == "keys of ground.1"
    assert not [e for e in log.entries if e.topic == topics.REJECTED]
    assert replay(log).identical  # without a key
    keys = [path.read_bytes() for path in (tmp_path / "keys" / "ground").glob("mavlink-*.key")]
    written = (out / "flight.mcap").read_bytes() + (out / "report.html").read_bytes()
    assert len(keys) == 2
    assert not any(key in written or bytes.fromhex(key.decode()) in written for key in keys)
    rows = json.loads(CliRunner().invoke(log_app, ["audit", str(out / "flight.mcap"), "--json"]).output)
    assert [row["what"] for row in rows if row["who"].startswith("tool.1")] == [
        "arm", "takeoff", "start", "hold", "land",
    ]  # fmt: skip
    assert rows[0]["what"].startswith("new ground, mocap, page, tool, drone-1, drone-2")
