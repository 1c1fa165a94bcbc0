"""ULog, DataFlash, a Crazyflie's card and a bag: the same flight from each, pyulog's own figures, and damaged files."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyulog import ULog

import gcs_log
from analysis.load import load
from mavlink_formation.installation import install_command
from tests.analysis.imports.stranger import (
    FORMATS,
    LAG_S,
    OWN_MAP,
    attitude,
    crazyflie,
    crazyflie_tables,
    position,
    px4_tables,
    times,
    ulog,
)
from tests.analysis.imports.test_import import imported, run
from tests.mocap.test_rosbag import POSE, RATE_HZ, TEXT, written


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_gives_the_same_flight(kind: str, tmp_path: Path) -> None:
    ending, data = FORMATS[kind]
    (tmp_path / f"bird.{ending}").write_bytes(data(8.0))
    flight = load(imported(tmp_path, tmp_path / f"bird.{ending}"))
    assert [(v.body, v.sysid) for v in flight.vehicles] == [("bird", 1)]
    np.testing.assert_allclose(flight.poses.t_s, times(), atol=2e-6)
    np.testing.assert_allclose(flight.poses.pos_lab_m[:, 0], position(times()), atol=1e-6)
    np.testing.assert_allclose(flight.poses.q_lab_from_flu[:, 0], attitude(times()), atol=1e-6)
    np.testing.assert_allclose(flight.target["q_lab_from_flu"][:, 0], attitude(times() + LAG_S), atol=1e-6)
    np.testing.assert_allclose(flight.target["thrust_norm"][:, 0], 0.48 + 0.02 * np.sin(times()), atol=1e-6)
    if kind != "Crazyflie":
        assert [(event.text, event.subject) for event in flight.events.messages] == [("low battery", "bird")]


def test_ulog_has_every_number_that_pyulog_reads(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(ulog(px4_tables(2.0)))
    log = gcs_log.load(imported(tmp_path, tmp_path / "a.ulg"))
    (cpu,) = (each for each in ULog(str(tmp_path / "a.ulg")).data_list if each.name == "cpuload")
    table = log["import/column/cpuload"]
    assert table["load"].tolist() == cpu.data["load"].tolist()
    np.testing.assert_allclose(table["t_s"], (cpu.data["timestamp"] - 5_000_000) * 1e-6, atol=1e-9)
    assert set(log["import/column/trajectory_setpoint"]) >= {"position[0]", "position[2]"}  # NaN: no reference


def test_instances_are_tables_of_their_own(tmp_path: Path) -> None:
    (tmp_path / "a.bin").write_bytes(FORMATS["DataFlash"][1](8.0))
    log = gcs_log.load(imported(tmp_path, tmp_path / "a.bin"))
    np.testing.assert_allclose(log["import/signal/battery_voltage"]["battery_v"], 12.0 + 0.01 * times()[::2], atol=1e-6)
    np.testing.assert_allclose(log["import/column/BAT#1"]["Volt"], 12.0 + 0.01 * times()[1::2], atol=1e-6)


def test_what_was_published_long_before_the_log_is_at_its_beginning(tmp_path: Path) -> None:
    data = bytearray(ulog(px4_tables(2.0), begin_us=9_000_000_000))
    first = data.index((4).to_bytes(2, "little") + (9_000_000_000).to_bytes(8, "little"))
    data[first + 2 : first + 10] = (17).to_bytes(8, "little")
    (tmp_path / "a.ulg").write_bytes(data)
    t_s = gcs_log.load(imported(tmp_path, tmp_path / "a.ulg"))["import/column/cpuload"]["t_s"]
    np.testing.assert_allclose(t_s, times(2.0), atol=1e-9)


def test_first_version_of_a_crazyflies_log_counts_milliseconds(tmp_path: Path) -> None:
    (tmp_path / "log00").write_bytes(crazyflie(crazyflie_tables(2.0), version=1))
    np.testing.assert_allclose(load(imported(tmp_path, tmp_path / "log00")).poses.t_s, times(2.0), atol=1e-6)


def test_bag_needs_a_map_and_is_stamped_by_its_headers(tmp_path: Path) -> None:
    bag = written(tmp_path / "bag", {"/bird/pose": (POSE, 1.0), "/chatter": (TEXT, 0.0)})
    text = OWN_MAP[OWN_MAP.index("signals") :].partition('{quantity = "commanded')[0] + "]\n"
    text = text.replace("pos_{n,e,d}", "/bird/pose.pose.position.{x,y,z}").replace(', unit = "mm"', "")
    text = text.replace('"roll", "pitch", "yaw"', '"/bird/pose.pose.orientation.{w,x,y,z}"').replace(
        ', unit = "deg"', ""
    )
    (tmp_path / "map.toml").write_text(text)
    log = imported(tmp_path, bag, map=str(tmp_path / "map.toml"))
    flight = load(log)
    np.testing.assert_allclose(flight.poses.pos_lab_m[:, 0, 0], 1.0 + 0.01 * np.arange(20), atol=1e-9)
    np.testing.assert_allclose(np.diff(flight.poses.t_s), 1.0 / RATE_HZ, atol=1e-6)
    assert gcs_log.load(log).date.timestamp() == pytest.approx(1_795_000_000.0, abs=1e-3)
    result = run("import", bag, "--out", tmp_path / "x.mcap")
    assert result.exit_code == 2
    assert "no shipped map knows its columns" in result.output


@pytest.mark.parametrize("kind", FORMATS)
def test_file_that_is_cut_short_gives_what_is_whole(kind: str, tmp_path: Path) -> None:
    data = FORMATS[kind][1](8.0)
    (tmp_path / "cut").write_bytes(data[: len(data) // 2 + 3])
    result = run("import", tmp_path / "cut", "--out", tmp_path / "x.mcap")
    assert result.exit_code == 1
    (line,) = [line for line in result.output.splitlines() if line.startswith("gcs-log: ")]
    assert f"{tmp_path / 'cut'}: " in line
    assert "byte" in line
    poses = load(tmp_path / "x.mcap").poses
    assert 3.0 < poses.t_s[-1] < 5.0
    np.testing.assert_allclose(poses.pos_lab_m[:, 0], position(poses.t_s), atol=1e-5)


def changed(data: bytes, old: bytes, new: bytes) -> bytes:
    assert old in data
    return data.replace(old, new, 1)


@pytest.mark.parametrize(
    ("kind", "old", "new", "words"),
    [
        (
            "ULog",
            b"float[4] q_d;float[3] thrust_body;",
            b"float[65000] q_d;float thrust_bod;",
            "larger than a message",
        ),
        ("ULog", b"float[4] q;", b"cpuload[2] q;", ""),
        ("ULog", b"cpuload:uint64_t timestamp;float load;", b"cpuload:uint64_t timestamp;cpuload lo;", "holds itself"),
        ("ULog", b"ULog\x01\x12\x35", b"ULog\x01\x12\x36", "is none of ULog"),
        ("DataFlash", b"TimeUS,ThO", b"TimeUS,\xff\xff\xff", ""),
        ("DataFlash", b"\x8e\x0fCTUN", b"\x8e\x00CTUN", "messages of 0 bytes"),
        ("DataFlash", b"TimeUS,Inst", b",TimeUSInst", ""),
        ("Crazyflie", b"\xbc\x02\x00", b"\xbc\x09\x00", "version 9 of a Crazyflie's log"),
        ("Crazyflie", b"stateEstimate.x(f)", b"stateEstimate.x(?)", "its header is damaged"),
        ("Crazyflie", b"\xbc\x02\x00\x02\x00", b"\xbc\x02\x00\xff\xff", "its header is damaged"),
    ],
)
def test_damage_ends_in_one_line(kind: str, old: bytes, new: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / "bad").write_bytes(changed(FORMATS[kind][1](8.0), old, new))
    result = run("import", tmp_path / "bad", "--out", tmp_path / "x.mcap")
    assert isinstance(result.exception, SystemExit | None)
    if words:
        assert result.exit_code == 1
        assert words in result.output
        assert len(result.output.strip().splitlines()) == 1


@pytest.mark.parametrize(("kind", "module"), [("ULog", "pyulog"), ("rosbag2", "rosbags.highlevel")])
def test_names_the_extra_that_is_missing(kind: str, module: str, tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setitem(__import__("sys").modules, module, None)
    data = FORMATS["ULog"][1](1.0) if kind == "ULog" else b"\x89MCAP0\r\n"
    (tmp_path / "a").write_bytes(data)
    result = run("import", tmp_path / "a", "--out", tmp_path / "x.mcap")
    assert result.exit_code == 2
    assert install_command("import") in result.output
