"""For a lab's own tests: the fixture `formation_flight` flies a scenario in lockstep and holds it to what is required.

    def test_our_line(formation_flight):
        summary = formation_flight("our_line.toml", seed=7, require=["formation_rms_m<0.005", "min_separation_m>0.4"])

`pytest --max-formation-rms 0.005` requires that of every such flight. Nothing is loaded until one is flown.
"""

import re
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import pytest

if TYPE_CHECKING:
    from analysis.metrics import Summary

MOST = {
    "--max-formation-rms": ("formation_rms_m", "the followers' formation error, RMS, m"),
    "--max-formation-error": ("formation_max_m", "their largest formation error, m"),
    "--max-leader-rms": ("leader_rms_m", "a commanded leader's tracking error, RMS, m"),
}


class FormationFlight(Protocol):
    """What the fixture gives."""

    def __call__(self, scenario: str | Path, *, seed: int | None = None, require: Iterable[str] = ()) -> "Summary":
        """Fly a scenario, shipped by its name or a TOML file; its numbers.

        Fails the test where the flight does not land, or misses what is required; its log and report are then kept
        in `runs/TEST` here, beside those of `gcs-sim run`. Of others they are in the test's temporary folder.
        """


def pytest_addoption(parser: pytest.Parser) -> None:
    """The bounds that hold for every flight of a run."""
    group = parser.getgroup("formation flights")
    for option, (key, meaning) in MOST.items():
        group.addoption(
            option, dest=key, type=float, metavar="M", help=f"at most, of every formation_flight: {meaning}"
        )


def _keep(flown: Path, test: str) -> Path:
    """Copy a flight's folder to where a workflow collects flights, under the test's name, anew if it is there."""
    kept = Path("runs") / re.sub(r"[^\w.-]+", "-", test)
    shutil.copytree(flown, kept, dirs_exist_ok=True)
    return kept


@pytest.fixture
def formation_flight(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> FormationFlight:
    """Flies in lockstep; the same scenario and seed give the same numbers."""

    def fly(scenario: str | Path, *, seed: int | None = None, require: Iterable[str] = ()) -> "Summary":
        from analysis import requirements
        from sim import lockstep
        from sim.cli.conclude import conclude
        from sim.scenario import load

        bounds = {key: request.config.getoption(key) for key, _ in MOST.values()}
        wanted = [f"{key}<={bound}" for key, bound in bounds.items() if bound is not None]
        parsed = [requirements.parse(text) for text in (*require, *wanted)]
        loaded = load(str(scenario))
        log = tmp_path_factory.mktemp("flight") / "flight.mcap"
        flown = lockstep.run_to_file(loaded, loaded.seed if seed is None else seed, log)
        _, summary = conclude(log, flown.outcome, flown.realtime_factor)
        missed = requirements.unmet(parsed, summary)
        if summary.outcome not in ("landed", "held"):
            missed = (summary.outcome, *missed)
        if missed:
            kept = _keep(log.parent, request.node.name)
            pytest.fail(f"{loaded.name}: {'; '.join(missed)} (see {kept / 'report.html'})", pytrace=False)
        return summary

    return fly
