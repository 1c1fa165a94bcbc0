"""A stranger's path: another's file -> import -> check -> report -> identify, tables; and what is refused."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import gcs_log
from analysis.cli import app
from analysis.load import load
from formation.maths import frames
from tests.analysis.imports.stranger import (
    BEGIN_S,
    LAG_S,
    OWN_MAP,
    attitude,
    neural_fly,
    own_csv,
    position,
    times,
    write_csv,
)


def run(*words: str | Path) -> Result:
    return CliRunner().invoke(app, [str(word) for word in words])


def imported(folder: Path, *files: Path, **options: str) -> Path:
    more = [word for key, value in options.items() for word in (f"--{key}", value)]
    result = run("import", *files, "--out", folder / "flight.mcap", *more)
    assert result.exit_code == 0, result.output
    return folder / "flight.mcap"


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stranger")
    (folder / "map.toml").write_text(OWN_MAP)
    return imported(folder, own_csv(folder / "strange.csv"), map=str(folder / "map.toml"))


def test_ned_degrees_and_millimetres_become_lab_flu_and_si(flown: Path) -> None:
    flight = load(flown)
    assert [(v.body, v.sysid) for v in flight.vehicles] == [("kestrel", 1)]
    t_s = np.delete(times(), [5, 6, 7])  # where a position is missing there is no frame
    np.testing.assert_allclose(flight.poses.t_s, t_s, atol=2e-6)
    np.testing.assert_allclose(flight.poses.pos_lab_m[:, 0], position(t_s), atol=1e-8)
    np.testing.assert_allclose(flight.poses.q_lab_from_flu[:, 0], attitude(t_s), atol=1e-9)
    np.testing.assert_allclose(flight.target["q_lab_from_flu"][:, 0], attitude(times() + LAG_S), atol=1e-6)
    np.testing.assert_allclose(flight.target["thrust_norm"][:, 0], 0.48 + 0.02 * np.sin(times()), atol=1e-7)
    assert np.isnan(flight.target["rate_flu_rad_s"]).all()  # missing, not zero
    assert {quantity for _, quantity in flight.signals} == {
        "position", "attitude", "commanded_attitude", "commanded_thrust",
    }  # fmt: skip


def test_its_date_is_the_files_and_other_columns_are_tables(flown: Path) -> None:
    log = gcs_log.load(flown)
    assert log.date.timestamp() == pytest.approx(BEGIN_S, abs=1e-3)
    others = log["import/column/strange"]
    assert set(others) == {"t_s", "unix_ns", "body", "esc_temp"}  # words are left out
    np.testing.assert_allclose(others["esc_temp"], 40.0 + times())
    thrust = log["import/signal/commanded_thrust"]
    assert len(thrust["commanded_thrust_norm"]) == len(times())
    assert set(thrust["body"]) == {"kestrel"}


def test_check_says_what_can_be_asked_and_what_cannot(flown: Path) -> None:
    found = json.loads(run("check", flown, "--json").stdout)
    assert found["complete"]
    assert {"attitude against target, and its lag by identify", "thrust curve by identify"} <= set(found["usable"])
    assert {"error to the reference", "gyros: join by the motion", "motor commands", "battery"} <= set(found["lost"])


def test_report_and_identify_work_on_it(flown: Path) -> None:
    result = run("report", flown, "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["outcome"] == "imported"
    page = flown.with_name("report.html").read_text()
    assert "Another recorder" in page
    found = json.loads(run("identify", flown, "--json").stdout)
    lag = found["drones"]["kestrel"]
    whole_s = lag["response_dead_time_s"]["value"] + lag["response_lag_s"]["value"]
    assert whole_s == pytest.approx(LAG_S, abs=0.01)
    assert found["mocap"]["mocap_delay_s"] is None  # no ground received these poses


def test_log_that_is_there_is_refused(flown: Path) -> None:
    before = flown.read_bytes()
    result = run("import", flown.with_name("strange.csv"), "--out", flown, "--map", flown.with_name("map.toml"))
    assert result.exit_code == 2
    assert "it is there already" in result.output
    assert flown.read_bytes() == before


def nanobench(folder: Path) -> Path:
    """Its columns, or those of them that have a meaning to us; no controller wrote its commands."""
    t_s = times()
    q, pos = attitude(t_s), position(t_s)
    columns = {"t": BEGIN_S + t_s} | {f"p{a}": c for a, c in zip("xyz", pos.T, strict=True)}
    columns |= {f"q{a}": -c for a, c in zip("wxyz", q.T, strict=True)}
    columns |= {f"imu_gyro_{a}": np.sin(t_s) for a in "xyz"} | {f"imu_acc_{a}": np.cos(t_s) for a in "xyz"}
    columns |= {f"sp_ctrltarget_{a}": c + 0.03 for a, c in zip("xyz", pos.T, strict=True)}
    columns |= {f"motor_motor_m{k}": 32767.5 + 100 * np.sin(t_s) for k in (1, 2, 3, 4)}
    zero = np.zeros(len(t_s))
    columns |= {f"pid_controller_{a}": zero for a in ("roll", "pitch", "yaw", "cmd_thrust")}
    return write_csv(folder / "B2_circle.csv", columns | {"att_stateEstimate_qw": q[:, 0]})


def neural_swarm(folder: Path) -> Path:
    t_s = times()
    pos, q = position(t_s).T, attitude(t_s).T
    return write_csv(
        folder / "cf1.csv",
        {"# time[ms]": 1e6 * t_s, **{f"{a}[m]": c for a, c in zip("xyz", pos, strict=True)},
         **{f"q{a}": c for a, c in zip("wxyz", q, strict=True)}, "thrust_des[g]": t_s, "Vbat[V]": 4.0 - 0.01 * t_s},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("make", "quantities", "error_m"),
    [
        (nanobench, {"rates", "acceleration", "motors", "reference_position"}, 0.03 * 3**0.5),
        (neural_fly, {"commanded_attitude", "commanded_thrust", "motors", "reference_position"}, 0.03 * 3**0.5),
        (neural_swarm, {"battery_voltage"}, None),
    ],
)
def test_known_layouts_need_no_map(make: Any, quantities: set[str], error_m: float | None, tmp_path: Path) -> None:
    log = imported(tmp_path, make(tmp_path))
    flight = load(log)
    assert {name for _, name in flight.signals} == {"position", "attitude"} | quantities
    np.testing.assert_allclose(flight.poses.q_lab_from_flu[:, 0], attitude(times()), atol=1e-6)
    if "motors" in quantities:
        (motors,) = (signal.values for (_, name), signal in flight.signals.items() if name == "motors")
        assert motors.shape[1] == 4
        assert np.abs(motors - 0.5).max() < 0.01
    summary = json.loads(run("report", log, "--json").stdout)
    assert summary["leader_rms_m"] == (None if error_m is None else pytest.approx(error_m, rel=1e-3))


def test_several_files_are_vehicles_on_one_clock(tmp_path: Path) -> None:
    first, t_s = neural_swarm(tmp_path), times()
    second = write_csv(
        tmp_path / "cf2.csv",
        {"# time[ms]": 1e6 * (t_s[:400] + 0.003), **{f"{a}[m]": t_s[:400] for a in "xyz"},
         "qw": np.ones(400), **{f"q{a}": np.full(400, 1e-9) * t_s[:400] for a in "xyz"}, "thrust_des[g]": t_s[:400],
         "Vbat[V]": t_s[:400]},
    )  # fmt: skip
    flight = load(imported(tmp_path, first, second))
    assert [(v.body, v.sysid) for v in flight.vehicles] == [("cf1", 1), ("cf2", 2)]
    assert flight.poses.seen[:, 0].all()
    at_s = flight.poses.t_s
    seen = flight.poses.seen[:, 1]
    np.testing.assert_allclose(flight.poses.pos_lab_m[seen, 1, 0], at_s[seen] - 0.003, atol=1e-9)
    assert at_s[seen].max() < 4.0


GOOD = {"t": ["0.00", "0.01", "0.02", "0.03"], "a": ["1", "2", "3", "4"]}
MAP = 'clock = {column = "t"}\nsignals = [{quantity = "battery_voltage", columns = ["a"]}]\n'


@pytest.mark.parametrize(
    ("columns", "by", "code", "words"),
    [
        (GOOD | {"t": ["0", "0.01", "nan", "0.03"]}, MAP, 1, "row 3: its stamp is not a number"),
        (GOOD | {"t": ["5", "5.01", "2", "5.03"]}, MAP, 1, "row 3: time goes back from 5.01 to 2 s"),
        (GOOD | {"t": ["0", "1", "2", "99999"]}, MAP, 1, "stamps jump from 2 to 99999 s"),
        (GOOD | {"a": ["1", "2", "x", "4"]}, MAP, 1, ":4 a: 'x' is not a number"),
        (GOOD | {"a": ["[1,2]", "[1]", "[1,2]", "[1,2]"]}, MAP, 1, ":3 a: 1 numbers in a list of 2"),
        (GOOD | {"a": ["", "", "", ""]}, MAP, 1, "no row of numbers"),
        (GOOD, "", 2, "no shipped map knows its columns (t, a"),
        (GOOD, MAP.replace('"t"', '"time"'), 2, "has its clock in a column 'time'; columns are t, a"),
        (GOOD, MAP.replace('"a"', '"b"'), 2, "has no column that your map names"),
        (GOOD, MAP.replace("battery_voltage", "volts"), 2, "signals[0].quantity: is none of position, attitude"),
        (GOOD, MAP.replace('"]}', '"], unit = "kV"}'), 2, "'kV'"),
        (GOOD, MAP.replace("battery_voltage", "position"), 2, "position has 3 columns, here are 1"),
    ],
)
def test_rejects_in_one_line_that_names_file_and_line(
    columns: Mapping[str, Sequence[str]], by: str, code: int, words: str, tmp_path: Path
) -> None:
    file, chosen = write_csv(tmp_path / "bad.csv", columns), tmp_path / "map.toml"
    chosen.write_text(by)
    result = run("import", file, "--out", tmp_path / "x.mcap", *(("--map", chosen) if by else ()))
    assert result.exit_code == code
    assert words in result.output
    assert len(result.output.strip().splitlines()) == 1
    assert "bad.csv" in result.output or "map.toml" in result.output
    assert not list(tmp_path.glob("*.mcap"))


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "is empty"),
        (b"0,1\n2,3\n", ":1: no header"),
        (b"t,a\n0,1\n\xff,2\n", "no text of columns"),
        (b"\x7fELF\0\0\0\0", "is none of ULog"),
    ],
)
def test_rejects_what_is_no_log(data: bytes, words: str, tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_bytes(data)
    (tmp_path / "map.toml").write_text(MAP)
    result = run("import", tmp_path / "bad.csv", "--out", tmp_path / "x.mcap", "--map", tmp_path / "map.toml")
    assert result.exit_code == 1
    assert words in result.output


def test_csv_that_is_cut_short_gives_what_is_whole_and_exit_code_1(tmp_path: Path) -> None:
    file = tmp_path / "cut.csv"
    file.write_text("t,a,b\n0,1,2\n0.01,2,3\n0.02,3")
    (tmp_path / "map.toml").write_text(MAP)
    result = run("import", file, "--out", tmp_path / "x.mcap", "--map", tmp_path / "map.toml")
    assert result.exit_code == 1
    assert f"{file}:4: 2 columns under a header of 3: cut short there" in result.output
    assert gcs_log.load(tmp_path / "x.mcap")["import/signal/battery_voltage"]["battery_v"].tolist() == [1.0, 2.0]


def test_attitudes_between_samples_go_the_shorter_way() -> None:
    q = frames.from_yaw(np.array([3.1, 3.2]))  # canonical quaternions change sign between them
    between = frames.interpolated(np.array([0.0, 1.0]), q, np.array([0.5]))
    np.testing.assert_allclose(frames.rotate(between[0], np.array([1.0, 0.0, 0.0])), [np.cos(3.15), np.sin(3.15), 0.0])
