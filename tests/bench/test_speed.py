"""What people wait for, measured: that a command's cost is its own, and what is shown of it."""

import json
import subprocess
from pathlib import Path

import pytest

from bench.speed import ROOT, ROWS, AgainstError, Cost, Measured, checkout, cost, flight, least, table, to_json

BUSY = "import time\nwhile time.process_time() < 0.3: pass"


def test_the_cost_of_a_command_holds_what_it_starts(tmp_path: Path) -> None:
    started = f"import subprocess, sys; subprocess.run([sys.executable, '-c', {BUSY!r}])"
    found = cost(ROOT, ("-c", started), tmp_path)
    assert 0.3 < found.cpu_s < 3.0
    assert found.peak_mb < 60.0


def test_a_command_that_fails_is_named_with_its_last_words(tmp_path: Path) -> None:
    with pytest.raises(AgainstError, match="no such thing"):
        cost(ROOT, ("-c", "import sys; sys.exit('no such thing')"), tmp_path)


def test_a_ratio_is_of_cpu_time_here_over_there() -> None:
    here = least([Cost(2.0, 9.0, 90.0), Cost(3.0, 2.0, 80.0)])
    assert here == Cost(2.0, 2.0, 80.0)
    found = [Measured(ROWS[0], here, Cost(8.0, 8.0, 100.0)), Measured(ROWS[1], here, None)]
    told = json.loads(to_json(found, 60.0, "abc"))["rows"]
    assert told["load"]["ratio"] == 0.25
    assert (told["tables"]["there"], told["tables"]["ratio"]) == (None, None)
    columns = [list(column.cells) for column in table(found, "abc").columns]
    assert [columns[k] for k in (0, 1, 5)] == [["load", "tables"], ["2.00", "2.00"], ["0.25", ""]]


def test_the_files_are_those_of_the_commit_and_gone_afterwards(tmp_path: Path) -> None:
    git = ["git", "-C", str(tmp_path), "-c", "user.name=n", "-c", "user.email=e@example.org"]
    file = tmp_path / "speed.txt"
    subprocess.run([*git, "init", "--quiet"], check=True)
    for text in ("slow", "fast"):
        file.write_text(text)
        subprocess.run([*git, "add", "speed.txt"], check=True)
        subprocess.run([*git, "commit", "--quiet", "--message", text], check=True)
    with checkout("HEAD~1", tmp_path) as folder:
        assert (folder / "speed.txt").read_text() == "slow"
    assert not folder.exists()
    assert file.read_text() == "fast"
    with pytest.raises(AgainstError, match="none-such"), checkout("none-such", tmp_path):
        pass


def test_the_flight_lasts_as_long_as_is_asked() -> None:
    scenario = flight(33.0)
    assert scenario.lab.leader.trajectory.duration_s == scenario.formation_s == 33.0
