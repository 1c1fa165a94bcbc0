"""What drones and people said is shown as it was said: never read as markup, never a reason to fail."""

from dataclasses import replace
from io import StringIO
from pathlib import Path

import pytest
from rich.console import Console

from gcs.cli.operator import print_status
from gcs.finding import Finding, Grade, show
from tests.gcs.fakes import FakeLab, triangle

WORDS = ["[/]", "[bold]x", "[link=http://x]y[/link]", "[/bold red]", "\\[", ":smile:"]


@pytest.mark.parametrize("words", WORDS)
def test_a_status_and_a_finding_show_words_as_they_are(words: str) -> None:
    state = FakeLab(triangle()).state
    drone = replace(state.drones[0], body=words, autopilot=words, mode=words)
    failures = (f"left: {words}",)
    state = replace(state, cause=words, shape=words, drones=(drone,), prearm_failures=failures, log_trouble=words)
    shown = Console(file=StringIO(), width=400, force_terminal=True, color_system=None)
    print_status(state, shown)
    show([Finding(words, words, Grade.FAIL, words, words, words)], shown)
    assert shown.file.getvalue().count(words) == 7 + 5


@pytest.mark.parametrize("date", ["../../../etc/x", "\x1b[2J/..", "a" * 5000])
def test_a_downloaded_log_stays_in_its_folder(date: str, tmp_path: Path) -> None:
    from gcs.doctor.mavsdk_drone import log_path  # loads MAVSDK

    path = log_path(tmp_path, "left", 3, date)
    assert path.parent == tmp_path
    assert path.name.startswith("left-3-")
    assert path.suffix == ".log"
