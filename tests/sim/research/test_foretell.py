"""Flights foretold: a stranger's path, from an empty folder to a foretold flight; laws of others; what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from analysis.cli import app as log_app
from analysis.identify.vehicle import identify
from analysis.imports.cli import import_files
from analysis.load import from_records, load
from formation.vehicle.profile import PROFILES
from gcs.cli.app import app as gcs_app
from sim.cli.app import app as sim_app
from sim.research.foretell import TICK_S, Course, course_of, errors, fly_on_board
from sim.research.laws import ChosenLaw, chosen
from sim.research.recorded import RecordedError
from tests.analysis.imports.stranger import neural_fly, write_csv

LAWS = Path(__file__).parents[3] / "examples" / "laws"
TRUE = PROFILES["crazyflie_27g"].model_copy(
    update={"thrust_max_n": 0.4, "thrust_curve": 0.0, "drag_n_s_m": (0.012, 0.012, 0.006), "attitude_p_1_s": 7.5}
)
MAP = """
title = "a stranger's"
clock = {column = "t"}
body = "wasp"
signals = [
    {quantity = "position", columns = ["p{x,y,z}"]},
    {quantity = "attitude", columns = ["q{w,x,y,z}"]},
    {quantity = "reference_position", columns = ["r{x,y,z}"]},
    {quantity = "commanded_attitude", columns = ["c{w,x,y,z}"]},
    {quantity = "commanded_thrust", columns = ["u"]},
]
"""
LAB = """
leader = {body = "a", sysid = 1}
followers = [{body = "b", sysid = 2, offset_m = [-1.0, 0.0, 0.0], profile = "crazyflie_27g_wasp"}]
"""


def course(pos_lab_m: np.ndarray, vel_lab_m_s: np.ndarray | None = None) -> Course:
    t_s, still = TICK_S * np.arange(len(pos_lab_m)), np.zeros_like(pos_lab_m)
    return Course("wasp", t_s, pos_lab_m, still if vel_lab_m_s is None else vel_lab_m_s, still[:, 0], still, 0.0, 0.0)


def circle(seconds: float) -> np.ndarray:
    t_s = np.arange(0.0, seconds, TICK_S)
    return np.stack([np.cos(t_s), np.sin(1.1 * t_s), 1.0 + 0.2 * np.sin(1.7 * t_s)], axis=1)


def run(app: object, *words: str | Path) -> Result:
    result = CliRunner().invoke(app, [str(word) for word in words])  # type: ignore[arg-type]
    assert result.exit_code == 0, result.output
    return result


def test_from_an_empty_folder_to_a_foretold_flight_in_four_commands(tmp_path: Path) -> None:
    """The CSV of a vehicle that no preset is; its law flies another vehicle's reference within a tenth of its error."""
    reference = circle(40.0)
    flown = fly_on_board(course(reference), TRUE, chosen(str(LAWS / "crazyflie_pid.py")).maker()(), 3)
    columns = {"t": TICK_S * np.arange(len(reference)), "u": flown.thrust_norm}
    for name, axes, values in (
        ("p", "xyz", flown.pos_lab_m), ("q", "wxyz", flown.q_lab_from_flu), ("r", "xyz", reference),
        ("c", "wxyz", flown.commanded_q_lab_from_flu),
    ):  # fmt: skip
        columns |= {name + axis: column for axis, column in zip(axes, values.T, strict=True)}
    grounded = {key: np.concatenate([np.tile(column[:1], 50), column]) for key, column in columns.items()}
    grounded["t"] = TICK_S * np.arange(len(grounded["t"]))
    grounded["pz"][:50] = 0.0
    table, log, profile = write_csv(tmp_path / "wasp.csv", grounded), tmp_path / "wasp.mcap", tmp_path / "wasp.toml"
    (tmp_path / "map.toml").write_text(MAP)
    run(log_app, "import", table, "--map", tmp_path / "map.toml", "--out", log)
    said = run(log_app, "identify", log, "--profile", "crazyflie_27g", "--write", profile).output
    assert "as in crazyflie_27g: mass_kg" in said
    lab = tmp_path / "lab.toml"
    lab.write_text(LAB + profile.read_text())
    run(gcs_app, "check", lab)
    law = LAWS / "crazyflie_pid.py"
    found = json.loads(run(sim_app, "foretell", log, "--profile", profile, "--law", law, "--json").output)
    assert found["off_share"] == pytest.approx(0.0, abs=0.1)
    assert found["path_rms_m"] < 0.1 * found["flown"]["rms_m"]
    assert found["foretold"]["delay_s"] == pytest.approx(found["flown"]["delay_s"], abs=0.03)
    assert "trust the simulator within" in run(sim_app, "foretell", log, "--profile", profile, "--law", law).output
    own = json.loads(run(sim_app, "foretell", log, "--profile", profile, "--json").output)
    assert own["builtin"] == "held"
    assert own["builtin_rms_m"] < 0.1 * own["flown"]["rms_m"]
    heavy = tmp_path / "heavy.toml"
    heavy.write_text(profile.read_text().replace("mass_kg = 0.027", "mass_kg = 0.04"))
    assert "does not fly" in run(sim_app, "foretell", log, "--profile", heavy).output


@pytest.mark.parametrize(
    ("law", "options", "behind_s"),
    [("crazyflie_pid", {}, 0.5), ("crazyflie_mellinger", {"ki_n_m_s": 0.0}, 0.5), ("px4_position", {}, 0.0)],
)
def test_laws_of_others_follow_a_line_as_far_behind_as_their_gains_say(
    law: str, options: dict[str, float], behind_s: float
) -> None:
    """By positions alone 1 / P, or D / P where no integral takes it out; PX4 takes the velocity, too. Without drag."""
    steady = TRUE.model_copy(update={"drag_n_s_m": (0.0, 0.0, 0.0)})
    t_s, speed = np.arange(0.0, 20.0, TICK_S), np.array([0.4, 0.2, 0.0])
    line = course(np.array([0.0, 0.0, 1.0]) + t_s[:, None] * speed, np.tile(speed, (len(t_s), 1)))
    led = line if law == "px4_position" else replace(line, vel_lab_m_s=np.zeros_like(line.pos_lab_m))
    path = fly_on_board(led, steady, ChosenLaw(str(LAWS / f"{law}.py"), tuple(options.items())).maker()(), 1).pos_lab_m
    behind_m = (line.pos_lab_m - path)[1000:, :2].mean(axis=0)
    assert behind_m == pytest.approx(behind_s * speed[:2], abs=0.03)
    if behind_s:
        assert errors(line, path, t_s > 10.0).delay_s == pytest.approx(behind_s, abs=0.1)


def test_a_log_without_a_reference_is_refused() -> None:
    with pytest.raises(RecordedError, match="no reference position"):
        course_of(from_records({}, []))


@pytest.mark.parametrize("seconds", [0.03, 0.1, 8.0])
def test_a_log_that_is_too_short_is_refused(tmp_path: Path, seconds: float) -> None:
    """A pose or two give no estimate, either."""
    log = tmp_path / "short.mcap"
    import_files([neural_fly(tmp_path, seconds)], log, None, lambda _text: None)
    with pytest.raises(RecordedError, match="follows no reference in the air for 8 s"):
        course_of(load(log))
    assert "too little uninterrupted free flight" in identify(load(log)).drones[0].untold or seconds > 1.0
