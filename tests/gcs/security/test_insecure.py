"""Programs refuse links to other machines without keys, and say so as long as they are asked to open them."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import tomli_w
from typer.testing import CliRunner

from formation.messages import Event
from formation.requests import OperatorReply
from gcs.cli.app import app as gcs_app
from gcs.cli.stop import stop
from tests.free_ports import free_port
from wire.logs.mcap_read import read_log
from wire.security.protection import INSECURE
from wire.transport import stop_call

LINE = "run `gcs keys new lab.toml` and write [security] into the lab file"


def exposed_lab(folder: Path, port: int) -> Path:
    """A lab whose ground listens at every address."""
    path = folder / "lab.toml"
    values = {
        "leader": {"body": "lead", "sysid": 1},
        "followers": [{"body": "left", "sysid": 2, "offset_m": [-0.5, 0.5, 0.0], "spawn_lab_m": [-0.5, 0.5, 0.0]}],
        "link": {"zenoh_listen": [f"tcp/0.0.0.0:{port}"], "zenoh_connect": []},
    }
    path.write_text(tomli_w.dumps(values))
    return path


def run(*words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([sys.executable, "-m", *words], capture_output=True, text=True, check=False)


@pytest.mark.processes
@pytest.mark.parametrize(
    "words",
    [
        ("gcs", "run", "LAB"),
        ("gcs", "doctor", "LAB", "--still"),
        ("gcs", "page", "LAB"),
        ("gcs", "mocap", "FAR"),
        ("gcs", "live", "FAR"),
        ("drone_agent", "--config", "DRONE"),
        ("drone_agent", "--config", "DRONE", "--link", "udp"),
        ("drone_agent", "--bridge", "udpin:0.0.0.0:14777"),
    ],
)
def test_no_program_opens_a_link_of_another_machine(words: tuple[str, ...], tmp_path: Path) -> None:
    lab = exposed_lab(tmp_path, free_port())
    far = tmp_path / "far.toml"
    far.write_text(lab.read_text().replace("0.0.0.0", "192.0.2.77"))
    drone = tmp_path / "drone.toml"
    drone.write_text('link = { host = "192.0.2.77", zenoh_connect = ["tcp/192.0.2.77:7447"] }')
    files = {"LAB": str(lab), "FAR": str(far), "DRONE": str(drone)}
    done = run(*(files.get(word, word) for word in words))
    assert done.returncode in (1, 2)
    assert LINE in done.stderr
    assert "Traceback" not in done.stderr


def test_no_command_asks_another_machine_in_the_clear_and_a_stop_believes_none(tmp_path: Path, monkeypatch) -> None:
    far = tmp_path / "far.toml"
    far.write_text('[link]\nzenoh_connect = ["tcp/ground.invalid:7447"]\n')
    done = CliRunner().invoke(gcs_app, ["status", "--lab", str(far)])
    assert done.exit_code == 2
    assert LINE in done.output.replace("\n", " ")
    monkeypatch.setattr(stop_call, "ask_to_stop", lambda *_: OperatorReply(1, True, "phase STOPPED"))
    assert stop(["--lab", str(far)]) == 2  # sent all the same
    assert stop(["--lab", str(far), "--insecure"]) == 0


@pytest.mark.processes
def test_an_insecure_ground_says_so_everywhere(tmp_path: Path) -> None:
    port, log = free_port(), tmp_path / "flight.mcap"
    lab = exposed_lab(tmp_path, port)
    command = [sys.executable, "-m", "gcs", "run", str(lab), "--insecure", "--log", str(log)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as ground:
        try:
            asked = ("gcs", "status", "--lab", str(lab), "--json", "--timeout", "60")
            state = json.loads(run(*asked).stdout)
            ground.send_signal(signal.SIGINT)
            _, said = ground.communicate()
        finally:
            ground.kill()
    assert any(alarm["text"] == INSECURE and alarm["goes_on"] for alarm in state["alarms"])
    assert f"security: {INSECURE}" in said
    recorded = read_log(log)
    assert recorded.metadata["security"] == "insecure"
    assert any(isinstance(e.message, Event) and e.message.text == INSECURE for e in recorded.entries)


@pytest.mark.processes
def test_an_emulated_camera_system_serves_this_machine_alone() -> None:
    done = run("sim", "mocap-server", "--protocol", "vicon", "--host", "0.0.0.0")
    assert done.returncode == 2
    assert "camera protocols know no keys: --insecure" in done.stderr
