"""The command lines of the studies: what they refuse, and what they hand on."""

from collections.abc import Callable
from pathlib import Path

import pytest
from typer.testing import CliRunner

from formation.vehicle.profile import PAPER_40G, PROFILES, VehicleProfile
from sim.cli.app import app
from sim.studies import paper
from sim.studies.runner import Runner
from wire.config_file import dump


def invoke(*arguments: str) -> tuple[int, str]:
    result = CliRunner().invoke(app, list(arguments))
    return result.exit_code, " ".join(result.output.split())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("paper", "--vehicle", "brick"), "unknown vehicle profile 'brick'; known: paper_40g, paper_40g_printed"),
        (("paper", "--only", "pdi"), "unknown controller 'pdi'; known: smc, istsmc"),
        (("tune", "paper_40g", "--gains", "pdi"), "unknown control preset 'pdi'"),
    ],
)
def test_what_is_unknown_is_refused_by_name(arguments: tuple[str, ...], said: str) -> None:
    code, output = invoke(*arguments)
    assert code == 2
    assert all(word in output for word in said.split())


def test_the_bound_is_that_of_the_vehicle_asked_for(tmp_path: Path) -> None:
    """Ten times the inertia is hard to turn; by name and by file alike."""
    own = tmp_path / "own.toml"
    own.write_text(dump(PROFILES["paper_40g_printed"]))
    told = {name: invoke("paper", "--bound", "--vehicle", name)[1] for name in ("paper_40g", str(own))}
    easy, hard = (float(text.split("acts after 40.0 ms:")[1].split("mm at least")[0]) for text in told.values())
    assert hard > 3.0 * easy


def test_the_fan_is_calibrated_for_the_vehicle_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[VehicleProfile] = []

    def calibrate(vehicle: VehicleProfile, _runner: Runner, flown: Callable[[float, float], None]) -> float:
        asked.append(vehicle)
        flown(7.0, 0.2966)
        return 7.0

    monkeypatch.setattr(paper, "calibrate", calibrate)
    code, output = invoke("paper", "--calibrate", "--vehicle", "paper_40g_printed")
    assert (code, output) == (0, "peak 7.000 m/s²: 296.6 mm peak_m_s2 = 7.00")
    assert [vehicle.name for vehicle in asked] == ["paper_40g_printed"]
    assert asked[0] != PAPER_40G
