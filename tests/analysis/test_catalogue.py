"""A folder of logs as a list: each flight a row, the damaged named, for people, JSON and SQLite alike."""

import json
import os
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis.cli import app
from tests.analysis.synthetic_flight import METADATA, Recipe, written
from wire.files import partial
from wire.logs.mcap_write import LogWriter


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A whole flight 2 mm off its slots, the same cut off, and a file that is no log."""
    runs = tmp_path_factory.mktemp("runs")
    error = 1e-3 * np.array([[2.0, 0.0, 0.0], [0.0, -2.0, 0.0]])
    for name in ("a", "b"):
        (runs / name).mkdir()
    whole = written(runs / "a" / "flight.mcap", Recipe(error_lead=lambda _: error), METADATA).read_bytes()
    (runs / "b" / "flight.mcap").write_bytes(whole[: len(whole) // 2])
    (runs / "c.mcap").write_text("no log\n")
    return runs


def test_every_log_has_a_row_and_damage_is_named(folder: Path, tmp_path: Path) -> None:
    database = tmp_path / "flights.db"
    done = CliRunner().invoke(app, ["list", str(folder), "--json", "--sqlite", str(database)])
    assert done.exit_code == 1
    whole, cut, none = json.loads(done.stdout)
    assert whole["formation_rms_m"] == pytest.approx(0.002, abs=1e-7)
    assert (whole["damage"], whole["outcome"]) == ("", "landed")
    assert cut["damage"]
    assert cut["duration_s"] < whole["duration_s"]
    assert (none["damage"], none["outcome"]) == (f"{folder / 'c.mcap'}: not an MCAP file", None)
    with sqlite3.connect(database) as read:
        assert [row[0] for row in read.execute("SELECT formation_rms_m FROM flights ORDER BY path")] == [
            whole["formation_rms_m"], cut["formation_rms_m"], None
        ]  # fmt: skip


def test_people_get_a_line_each_and_a_folder_without_logs_is_named(folder: Path, tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["list", str(folder / "a")])
    assert (done.exit_code, len(done.stdout.splitlines())) == (0, 1)
    assert "  2.00 mm" in done.stdout
    empty = CliRunner().invoke(app, ["list", str(tmp_path)])
    assert (empty.exit_code, empty.stderr) == (2, f"gcs-log: {tmp_path}: no log\n")


def test_the_oldest_whole_logs_go_until_the_others_fit(tmp_path: Path) -> None:
    """All are of simulated time, whose date is none: what counts is when they were written."""
    sizes = {}
    for day in (3, 1, 2):
        path = tmp_path / f"{day}.mcap"
        written(path, Recipe(), METADATA)
        os.utime(path, (1_767_200_000 + 86_400 * day,) * 2)
        sizes[path.name] = path.stat().st_size
    (tmp_path / "other.mcap").write_text("no log\n")
    kept = f"{sizes['3.mcap'] / 1e3 + sizes['2.mcap'] / 1e3 + 1.0}KB"
    done = CliRunner().invoke(app, ["list", str(tmp_path), "--keep", kept])
    assert (done.exit_code, done.stderr) == (1, f"deleted {tmp_path / '1.mcap'}\n")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["2.mcap", "3.mcap", "other.mcap"]
    assert CliRunner().invoke(app, ["list", str(tmp_path), "--keep", "all"]).exit_code == 2
    assert len(list(tmp_path.iterdir())) == 3
    newest = json.loads(CliRunner().invoke(app, ["list", str(tmp_path), "--json"]).stdout)[1]
    assert (newest["date"], newest["simulated"]) == ("2026-01-03T16:53:20Z", "2000-01-01T00:00:00Z")


def test_what_we_wrote_is_not_called_damaged(tmp_path: Path) -> None:
    """A log that is being recorded, one of a ground that ended before its first frame, and another program's."""
    whole = written(tmp_path / "a.mcap", Recipe(), METADATA).read_bytes()
    partial(tmp_path / "b.mcap").write_bytes(whole[: len(whole) // 2])
    LogWriter(tmp_path / "c.mcap", METADATA, threaded=False).close()
    done = CliRunner().invoke(app, ["list", str(tmp_path), "--json", "--keep", "1KB"])
    assert (done.exit_code, done.stderr) == (0, f"deleted {tmp_path / 'a.mcap'}\n")
    rows = json.loads(done.stdout)
    assert [(row["damage"], row["unfinished"], row["outcome"] is None) for row in rows] == [
        ("", False, False), ("", True, False), ("", False, True)
    ]  # fmt: skip
