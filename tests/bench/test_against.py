"""The figures of two commits side by side: which commit is measured, and what is compared."""

import json
import subprocess
from pathlib import Path

import pytest

from bench.against import AgainstError, Compared, checkout, figures


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


def test_figures_have_their_path_as_a_name_and_swarms_their_size() -> None:
    values = {"swarms": [{"followers": 2, "tick": {"p50_us": 5.0, "count": 100}}], "parts": {"encode_us": 2}}
    assert figures(values) == {"swarms.2.tick.p50_us": 5.0, "parts.encode_us": 2.0}


def test_a_ratio_is_what_is_here_over_what_is_there() -> None:
    compared = Compared("abc123", {"tick": 3.0, "calls": 1.0}, {"tick": 2.0, "calls": 0.0})
    told = json.loads(compared.to_json())
    assert told["figures"]["tick"] == {"here": 3.0, "there": 2.0, "ratio": 1.5}
    assert told["figures"]["calls"]["ratio"] is None
    (table,) = compared.tables()
    assert [list(column.cells) for column in table.columns] == [
        ["tick", "calls"], ["2", "0"], ["3", "1"], ["1.50", ""],
    ]  # fmt: skip
