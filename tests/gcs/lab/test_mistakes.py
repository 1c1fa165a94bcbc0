"""Mistakes that a person makes in a lab file: `gcs check` names each by its key, and none passes."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from gcs.cli.app import app

LAB = """
name = "hall"
control_preset = "default"
security = {}
[mocap]
source = "vicon"
rate_hz = 100.0
delay_s = 0.008
latency_s = 0.005
axes = ["x forward", "y left", "z up"]
origin_lab_m = [0.0, 0.0, 0.0]
names = { "Quad 1" = "leader" }

[mocap.vicon]
host = "192.168.1.10"

[leader]
body = "leader"
sysid = 1
profile = "px4_quad"
link = "udp:192.168.1.31:14550"
guard = "none"
spawn_lab_m = [0.0, 0.0, 0.0]
trajectory = { kind = "circle", radius_m = 0.5, period_s = 12.0, laps = 2 }

[[followers]]
body = "right"
sysid = 2
profile = "px4_quad"
link = "udp:192.168.1.32:14550"
guard = "none"
offset_m = [-1.0, -1.0, 0.0]
q_marker_from_flu = [1.0, 0.0, 0.0, 0.0]

[[followers]]
body = "left"
sysid = 3
profile = "px4_quad"
link = "udp:192.168.1.33:14550"
guard = "none"
offset_m = [-1.0, 1.0, 0.0]
yaw_offset_rad = 0.0

[limits]
fence = { low_m = [-3.0, -3.0, -0.2], high_m = [3.0, 3.0, 2.5] }
min_separation_m = 0.5
speed_m_s = 2.0
tilt_rad = 0.5

[flight]
altitude_m = 1.0
climb_m_s = 0.4

[link]
zenoh_connect = ["tcp/127.0.0.1:7447"]
imu_rate_hz = 200.0
"""
LEFT = "offset_m = [-1.0, 1.0, 0.0]"
HOST = '[mocap.vicon]\nhost = "192.168.1.10"'
CIRCLE = 'kind = "circle", radius_m = 0.5, period_s = 12.0, laps = 2'
OURS = '[[profiles]]\nname = "ours"\nbase = "px4_quad"\n'
MISTAKES = [
    ("slot in millimetres", LEFT, "offset_m = [-1000.0, 1000.0, 0.0]", "followers[1].offset_m"),
    ("slot on the wrong side", LEFT, "offset_m = [-1.0, -1.0, 0.0]", "followers[1].offset_m"),
    ("slot with z down", LEFT, "offset_m = [-1.0, 1.0, -1.0]", "followers[1].offset_m"),
    ("slot at the leader", LEFT, "offset_m = [0.0, 0.0, 0.0]", "followers[1].offset_m"),
    ("slot outside the fence", LEFT, "offset_m = [-1.0, 4.0, 0.0]", "followers[1].offset_m"),
    ("slot without z", LEFT, "offset_m = [-1.0, 1.0]", "followers[1].offset_m[2]"),
    ("a sysid twice", "sysid = 3", "sysid = 2", "followers[1].sysid"),
    ("the ground's sysid", "sysid = 3", "sysid = 255", "followers[1].sysid"),
    ("a body twice", 'body = "left"', 'body = "right"', "followers[1].body"),
    ("a name of no body", '"Quad 1" = "leader"', '"Quad 1" = "laeder"', "mocap.names"),
    ("names the wrong way round", '"Quad 1" = "leader"', 'leader = "Quad 1"', "mocap.names.leader"),
    ("one link for two", "192.168.1.33:14550", "192.168.1.32:14550", "followers[1].link"),
    ("one port bound twice", "udp:192.168.1.", "udpin:0.0.0.", "followers[0].link"),
    ("a link without a port", "192.168.1.33:14550", "192.168.1.33", "followers[1].link"),
    ("a serial link of the ground's", "udp:192.168.1.33:14550", "serial:/dev/ttyUSB0:57600", "followers[1].link"),
    ("a link to an address that is none", "192.168.1.33", "192.168.1.333", "followers[1].link"),
    ("no host of the cameras", HOST, "", "mocap.vicon.host"),
    ("an address that is none", "192.168.1.10", "192.168.1", "mocap.vicon.host"),
    ("a host with its port", '"192.168.1.10"', '"192.168.1.10:801"', "mocap.vicon.host"),
    ("a table of another system", "[mocap.vicon]", "[mocap.vrpn]", "mocap.vicon.host"),
    ("a misspelt table", "[mocap.vicon]", "[mocap.vcion]", "mocap.vcion"),
    ("left-handed axes", '"y left"', '"y right"', "mocap.axes"),
    ("an axis twice", '"z up"', '"y up"', "mocap.axes"),
    ("a unit that Vicon does not send", 'source = "vicon"', 'source = "vicon"\nunit = "m"', "mocap.unit"),
    ("an origin in millimetres", "origin_lab_m = [0.0", "origin_lab_m = [1500.0", "mocap.origin_lab_m"),
    ("kilohertz", "rate_hz = 100.0", "rate_hz = 0.1", "mocap.rate_hz"),
    ("a delay in milliseconds", "delay_s = 0.008", "delay_s = 8.0", "mocap.delay_s"),
    ("more latency than delay", "latency_s = 0.005", "latency_s = 0.05", "mocap.latency_s"),
    ("w last", "[1.0, 0.0, 0.0, 0.0]", "[0.0, 0.0, 0.0, 1.0]", "followers[0].q_marker_from_flu"),
    ("no rotation", "[1.0, 0.0, 0.0, 0.0]", "[1.0, 0.0, 0.0, 1.0]", "followers[0].q_marker_from_flu"),
    ("tilt in degrees", "tilt_rad = 0.5", "tilt_rad = 30", "limits.tilt_rad"),
    ("heading in degrees", "yaw_offset_rad = 0.0", "yaw_offset_rad = 90.0", "followers[1].yaw_offset_rad"),
    ("height in centimetres", "altitude_m = 1.0", "altitude_m = 100", "flight.altitude_m"),
    ("height with z down", "altitude_m = 1.0", "altitude_m = -1.0", "flight.altitude_m"),
    ("climb in centimetres", "climb_m_s = 0.4", "climb_m_s = 40", "flight.climb_m_s"),
    ("the fence's corners exchanged", "low_m = [-3.0, -3.0, -0.2], high_m = [3.0, 3.0, 2.5]",
     "low_m = [3.0, 3.0, 2.5], high_m = [-3.0, -3.0, -0.2]", "limits.fence.low_m"),
    ("the fence above the floor", "-0.2]", "0.2]", "limits.fence.low_m"),
    ("separation in centimetres", "min_separation_m = 0.5", "min_separation_m = 50", "followers[0].offset_m"),
    ("radius in centimetres", "radius_m = 0.5", "radius_m = 50", "leader.trajectory.radius_m"),
    ("a lap in a second", "period_s = 12.0", "period_s = 1.0", "leader.trajectory.period_s"),
    ("a misspelt kind", '"circle"', '"cirle"', "leader.trajectory.kind"),
    ("another kind's key", CIRCLE, 'kind = "line", radius_m = 0.4', "leader.trajectory.radius_m"),
    ("a point without z", CIRCLE, 'kind = "waypoints", waypoints_m = [[1.0, 0.0]]',
     "leader.trajectory.waypoints_m[0][2]"),
    ("a file that is not there", CIRCLE, 'kind = "csv", file = "path.csv"', "leader.trajectory.file"),
    ("a misspelt profile", 'profile = "px4_quad"\nlink = "udp:192.168.1.33',
     'profile = "px4_qaud"\nlink = "udp:192.168.1.33', "followers[1].profile"),
    ("no profile of a real drone", 'profile = "px4_quad"\nlink = "udp:192.168.1.33', 'link = "udp:192.168.1.33',
     "followers[1].profile"),
    ("a misspelt preset", '"default"', '"defualt"', "control_preset"),
    ("a misspelt key", "climb_m_s", "clim_m_s", "flight.clim_m_s"),
    ("a start outside", "spawn_lab_m = [0.0", "spawn_lab_m = [30.0", "leader.spawn_lab_m"),
    ("an endpoint without its protocol", "tcp/127.0.0.1:7447", "127.0.0.1:7447", "link.zenoh_connect[0]"),
    ("more than the autopilot sends", "imu_rate_hz = 200.0", "imu_rate_hz = 1000", "link.imu_rate_hz"),
    ("a leader that is never armed", 'body = "leader"\nsysid = 1', 'body = "leader"', "leader.link"),
    ("a flag for a number", "speed_m_s = 2.0", "speed_m_s = true", "limits.speed_m_s"),
    ("a number in quotes", HOST, f'{HOST}\nport = "801"', "mocap.vicon.port"),
    ("a flag in quotes", HOST, f'{HOST}\n[mocap.vrpn]\nudp = "no"', "mocap.vrpn.udp"),
    ("a letter in an address", "192.168.1.10", "192.168.1.1O", "mocap.vicon.host"),
    ("a letter in an endpoint's address", "tcp/127.0.0.1:", "tcp/127.0.0.l:", "link.zenoh_connect[0]"),
    ("a broadcast for a multicast", HOST, f'{HOST}\n[mocap.natnet]\nmulticast = "192.168.1.255"',
     "mocap.natnet.multicast"),
    ("the server's address for our own", HOST, f'{HOST}\n[mocap.natnet]\nhost = "10.0.0.2"\ninterface = "10.0.0.2"',
     "mocap.natnet.interface"),
    ("a marker frame on its side", "[1.0, 0.0, 0.0, 0.0]", "[0.7071, 0.7071, 0.0, 0.0]",
     "followers[0].q_marker_from_flu"),
    ("another kind's key with its usual value", CIRCLE, 'kind = "line", radius_m = 0.3', "leader.trajectory.radius_m"),
    ("a stop button that is not there", "[flight]", '[operator]\nstop_button = { device = "/dev/nobody" }\n[flight]',
     "operator.stop_button.device"),
    ("no fence of a real room", "fence = { low_m = [-3.0, -3.0, -0.2], high_m = [3.0, 3.0, 2.5] }\n", "",
     "limits.fence"),
    ("a wheelbase in millimetres", "[flight]", f"{OURS}wheelbase_m = 300\n[flight]", "profiles[0].wheelbase_m"),
    ("a mass in grams", "[flight]", f"{OURS}mass_kg = 1000\n[flight]", "profiles[0].inertia_kg_m2"),
    ("a base that is not shipped", "[flight]", f"{OURS}[flight]".replace("px4_quad", "x5000"), "profiles[0].base"),
]  # fmt: skip


def check(folder: Path, text: str) -> tuple[int, list[str]]:
    """The exit code, and the keys of all errors and warnings."""
    file = folder / "lab.toml"
    file.write_text(text)
    result = CliRunner().invoke(app, ["check", str(file), "--json"])
    findings = json.loads(result.stdout)["findings"]
    return result.exit_code, [finding["subject"] for finding in findings if finding["grade"] != "pass"]


def test_the_lab_without_a_mistake_passes_but_for_what_nothing_guards(tmp_path: Path) -> None:
    assert check(tmp_path, LAB) == (0, ["leader.guard", "followers[0].guard", "followers[1].guard"])


@pytest.mark.parametrize(("right", "wrong", "key"), [m[1:] for m in MISTAKES], ids=[m[0] for m in MISTAKES])
def test_a_mistake_is_found_at_its_key(right: str, wrong: str, key: str, tmp_path: Path) -> None:
    assert right in LAB
    _, keys = check(tmp_path, LAB.replace(right, wrong))
    assert key in keys


def test_invalid_toml_is_rejected_with_its_line(tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text(LAB.replace("rate_hz = 100.0", "rate_hz = 100,0"))
    result = CliRunner().invoke(app, ["check", str(tmp_path / "lab.toml"), "--json"])
    assert result.exit_code == 2
    assert "line 7" in json.loads(result.stdout)["error"]
