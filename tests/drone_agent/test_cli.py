"""The command line: bad input is one line that names what is wrong, and exit code 2."""

import os
import subprocess
import sys
from dataclasses import replace
from itertools import islice
from pathlib import Path

import pytest
from typer.testing import CliRunner

from drone_agent.__main__ import Options, _config, app
from drone_agent.config import SimulatedDroneConfig
from formation.vehicle.profile import profile
from tests.free_ports import free_port

runner = CliRunner()


@pytest.fixture(autouse=True)
def ordinary_priority(monkeypatch: pytest.MonkeyPatch) -> None:
    """A command that raised its priority, as root may, would raise that of all later tests."""
    monkeypatch.setattr(os, "setpriority", lambda *_: None)


@pytest.mark.parametrize(
    ("code", "options", "keys", "words"),
    [
        (2, ["--sysid", "300"], "", "sysid: "),
        (2, ["--link", "tcp"], "", "link.kind: "),
        (2, [], "speed_kmh = 3", "FILE:1 speed_kmh: is not a known key"),
        (2, [], "start_lab_m = [1, 2]", "start_lab_m[2]: is missing"),
        (2, [], "autopilot = 'betaflight'", "FILE:1 autopilot: "),
        (2, [], "truth_rate_hz = -1", "FILE:1 truth_rate_hz: "),
        (2, [], "profile = 'nope'", "known: paper_40g, paper_40g_printed, px4_quad"),
        (2, [], "parameters = { NO_SUCH = 1 }", "parameters: 'NO_SUCH' is unknown"),
        (2, [], "parameters = { COM_OF_LOSS_T = 'soon' }", "parameters.COM_OF_LOSS_T: "),
        (2, ["--bridge", "tcp:there:1"], "", "is not udp:HOST:PORT, udpin:HOST:PORT or serial:DEV:BAUD"),
        (2, ["--bridge", "udp:127.0.0.1:99999"], "", "bridge: 'udp:127.0.0.1:99999' is not"),
        (2, ["--bridge", "serial:/dev/ttyUSB0"], "", "is not serial:DEV:BAUD"),
        (
            2,
            [],
            "link = { zenoh_connect = ['there'] }",
            "link.zenoh_connect[0]: not an endpoint such as ",
        ),
        (2, ["--config", "/nowhere/uav.toml"], "", "/nowhere/uav.toml: No such file"),
        (1, ["--bridge", "serial:/dev/no-such-line:57600"], "", "bridge serial:/dev/no-such-line:57600: "),
        (1, ["--link", "udp"], "link = { host = 'no-host.invalid' }", "link to no-host.invalid, own port 14581: "),
    ],
)
def test_what_is_not_right_or_cannot_be_had_is_named_in_one_line(
    code: int, options: list[str], keys: str, words: str, tmp_path: Path
) -> None:
    file = tmp_path / "uav.toml"
    file.write_text(keys)
    result = runner.invoke(app, [*options, *(["--config", str(file)] if keys else [])])
    assert result.exit_code == code
    assert words.replace("FILE", str(file)) in result.output
    assert len([line for line in result.output.splitlines() if "priority: " not in line]) == 1


@pytest.mark.parametrize("as_json", [[], ["--json"]])
def test_an_option_of_before_names_its_key(as_json: list[str]) -> None:
    result = runner.invoke(app, ["--truth=250", *as_json], env={"COLUMNS": "200"})
    assert result.exit_code == 2
    assert "--truth is now the key truth_rate_hz of the file that --config names" in result.output
    assert result.output.startswith('{"error": "--truth') is bool(as_json)


@pytest.mark.parametrize(
    ("second", "options", "words"),
    [
        ("sysid = 1", [], "sysid: each drone needs its own"),
        ("sysid = 2\nbridge = 'udp:127.0.0.1:14540'", [], "bridge: a bridge is a process of its own"),
        ("sysid = 2", ["--keys", "keys"], "keys: a drone with keys is a process of its own"),
        ("sysid = 2\nlab = 'other'", [], "lab: the drones of one process are in one lab"),
    ],
)
def test_what_one_process_cannot_be_together_is_named(
    second: str, options: list[str], words: str, tmp_path: Path
) -> None:
    files = tmp_path / "1.toml", tmp_path / "2.toml"
    files[0].write_text("sysid = 1\n")
    files[1].write_text(second)
    both = [word for file in files for word in ("--config", str(file))]
    result = runner.invoke(app, [*both, *options])
    assert (result.exit_code, result.output) == (2, f"drone-agent: {words}\n")


@pytest.mark.processes
def test_a_bridge_says_what_it_waits_for_and_what_to_do(tmp_path: Path) -> None:
    bus = f"tcp/127.0.0.1:{free_port()}"
    config = tmp_path / "bridge.toml"
    config.write_text(f"[link]\nzenoh_connect = ['{bus}']\n")
    bridge = f"udp:127.0.0.1:{free_port()}"
    options = ["--config", str(config), "--sysid", "2", "--body", "left", "--bridge", bridge]
    with subprocess.Popen(
        [sys.executable, "-m", "drone_agent", *options], stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        told = list(islice((line for line in process.stderr if "waiting for" in line), 3))
        process.terminate()
    assert f"waiting for the bus at {bus}: nobody is there: start the ground" in told[0]
    assert "link.zenoh_connect" in told[0]
    assert "waiting for the autopilot at udp:127.0.0.1" in told[1]
    assert "waiting for the mocap's pose of 'left'" in told[2]


LAB = """
name = "barn"
origin = [48.0, 11.0, 500.0]
[link]
zenoh_listen = ["tls/0.0.0.0:7447"]
zenoh_connect = []
[security]
keys = "our-keys"
addresses = ["192.168.1.20"]
[[profiles]]
name = "ours"
base = "px4_quad"
mass_kg = 1.9
[leader]
body = "leader"
[[followers]]
body = "left"
sysid = 7
profile = "ours"
offset_m = [-0.4, 0.4, 0.0]
"""


def test_a_lab_file_says_what_its_drone_is(tmp_path: Path) -> None:
    """And options win over it."""
    file = tmp_path / "lab.toml"
    file.write_text(LAB)
    options = Options(lab=str(file), body="left", bridge="serial:/dev/ttyACM0:921600")
    config = _config(options, None)
    assert (config.sysid, config.lab, config.body_name, config.origin[2]) == (7, "barn", "left", 500.0)
    assert profile(config.profile, config.profiles).mass_kg == 1.9
    assert config.link.zenoh_connect == ("tls/192.168.1.20:7447",)
    assert config.keys == tmp_path / "our-keys"
    assert _config(replace(options, sysid=8), None).sysid == 8
    simulated = _config(replace(options, bridge=None), None)
    assert isinstance(simulated, SimulatedDroneConfig)
    assert simulated.pose == "mocap"


@pytest.mark.parametrize(
    ("body", "words"), [(["--body", "leader"], "--body leader: its drones are left"), ([], "--body is missing: ")]
)
def test_a_body_that_is_no_drone_of_the_lab_is_named(body: list[str], words: str, tmp_path: Path) -> None:
    file = tmp_path / "lab.toml"
    file.write_text(LAB)
    result = runner.invoke(app, ["--lab", str(file), *body])
    assert (result.exit_code, len(result.output.splitlines())) == (2, 1)
    assert f"{file}: {words}" in result.output
