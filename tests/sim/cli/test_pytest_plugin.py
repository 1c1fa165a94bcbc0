"""The plug-in as another project's tests meet it: a run of pytest of its own."""

import tomllib
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from mavlink_formation.pytest_plugin import _failure
from tests.sim.short_scenario import SHORT

pytest_plugins = ["pytester"]
PROJECT = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
# As the installed package registers it, in this checkout's code.
PLUGIN = ("-p", "no:formation", "-p", PROJECT["entry-points"]["pytest11"]["formation"])
ALONE = (*PLUGIN, "-p", "no:cacheprovider", "-p", "no:xdist")
LAB = """
[leader]
body = "leader"
sysid = 1
trajectory = { kind = "hold", duration_s = 0.3 }
[[followers]]
body = "left"
sysid = 2
link = "udp:192.168.1.33:14550"
guard = "none"
profile = "paper_40g"
offset_m = [-0.5, 0.0, 0.0]
"""
TESTS = """
def test_reached(formation_flight):
    flown = formation_flight("lab.toml", seed=3, require=["formation_max_m<0.02", "min_separation_m>0.4"])
    assert (flown.scenario, flown.seed) == ("lab", 3)

def test_missed(formation_flight):
    formation_flight("short.toml", require=["min_separation_m>4"])
"""


def run(pytester: pytest.Pytester, *words: str) -> pytest.RunResult:
    """In a process of its own: pytester takes back what a run in this one has imported, matplotlib among it."""
    Path(pytester.path, "short.toml").write_text(SHORT)
    Path(pytester.path, "lab.toml").write_text(LAB)
    pytester.makepyfile(TESTS)
    return pytester.runpytest_subprocess(*ALONE, *words)


def test_a_labs_own_file_that_reaches_what_is_required_passes(pytester: pytest.Pytester) -> None:
    run(pytester, "-k", "reached", "--max-formation-rms", "0.02").assert_outcomes(passed=1, deselected=1)


def test_one_that_misses_what_its_test_or_the_command_line_requires_fails(pytester: pytest.Pytester) -> None:
    result = run(pytester, "-k", "missed", "--max-formation-rms", "1e-6")
    result.assert_outcomes(failed=1, deselected=1)
    result.stdout.fnmatch_lines(["*min_separation_m>4 is required, it is 0.*; formation_rms_m<=1e-06 is required*"])
    for name in ("flight.mcap", "report.html"):
        assert (pytester.path / "runs" / "test_missed" / name).exists()
    result.stdout.fnmatch_lines(["*(see runs/test_missed/report.html)*"])


def test_a_flight_that_ends_badly_says_how(tmp_path: Path) -> None:
    """The last line that `gcs-sim run` prints, whatever else it prints before."""
    flown = CompletedProcess([], 1, '{"outcome": "lost: left fell"}', "compiling\ngcs-sim: lost: left fell\n")
    assert _failure("line", flown, tmp_path) == "line: lost: left fell"
    (tmp_path / "report.html").touch()
    assert _failure("line", flown, tmp_path) == f"line: lost: left fell (see {tmp_path / 'report.html'})"


def test_the_example_workflow_installs_from_a_repository_and_collects_where_failing_flights_are_kept() -> None:
    workflow = (Path(__file__).parents[3] / "examples" / "formation-ci.yml").read_text()
    assert 'pip install "mavlink-formation[sim] @ $FORMATION"' in workflow
    assert "FORMATION: git+https://" in workflow
    assert "path: runs/" in workflow
