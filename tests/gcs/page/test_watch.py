"""`gcs watch` in 80 columns."""

import io
from dataclasses import replace

import pytest
import typer
from rich.console import Console

from formation.messages import Phase, Severity, Verb
from gcs.page.show import NOTHING_YET, Cell, Level, Show, Step, cause
from gcs.watch import picture, watch
from tests.gcs.fakes import FakeLab, triangle
from wire.ground_state import Alarm
from wire.process.system import NOT_RIGHT


def printed(shown: Show, *alarms: Alarm) -> list[str]:
    console = Console(width=80, record=True, file=io.StringIO())
    console.print(picture(shown, alarms, "hold: phase HOLD"))
    return console.export_text().splitlines()


def test_a_swarm_fits_into_80_columns_and_says_what_is_wrong():
    row = "12 follower_12 PX4 OFFBOARD ARMED air 15.2 97 24 26 120 0.9 12.5 1234 0.38 ok"
    cells = tuple(Cell(text, Level.BAD if text == "1234" else Level.CALM) for text in row.split(" "))
    shown = replace(NOTHING_YET, rows=(cells,) * 20, steps=(Step(Verb.ARM, ("left: no fresh pose",)),), lost="")
    long = Alarm(61.0, Severity.WARNING, "left", "refused: " + 9 * "27 x setpoint older than 100 ms, ", times=3)
    over = Alarm(70.0, Severity.ERROR, "safety", "left: low", cleared=True)
    lines = printed(shown, over, long, Alarm(0.0, Severity.ERROR, "safety", "right: outside the fence"))
    assert max(map(len, lines)) <= 80
    table = [line.split() for line in lines if line.startswith("12 ")]
    assert table[0][2:] == ["OFFBOARD", "ARMED", "97", "24", "26", "120", "0.9", "12.5", "1234", "0.38", "ok"]
    assert "Arm is not possible: left: no fresh pose" in "\n".join(lines)
    alarms = [line[2:] for line in lines if line[2:3] == ":"]
    assert [line[:23].strip() for line in alarms] == [":01:01 WARNING 3x left:", ":00:00 ERROR safety: ri"]
    assert len(alarms[0]) == 78
    assert "alarms: 1 cleared" in lines
    assert "NO CONNECTION TO THE GROUND" in printed(NOTHING_YET)[0]


def test_the_head_says_who_is_left_out():
    assert "left out: cf03" in printed(replace(NOTHING_YET, lost="", phase=Phase.GROUND, left_out="left out: cf03"))[0]


def test_without_a_keyboard_it_ends_in_one_line(monkeypatch, capsys):
    monkeypatch.setattr("sys.stdin", io.StringIO())
    with pytest.raises(typer.Exit) as ended:
        watch(None, "gcs")
    assert ended.value.exit_code == NOT_RIGHT
    assert "standard input is none" in capsys.readouterr().err


def test_in_hold_it_says_that_the_operator_resumes():
    """The cause may be long over: no formation resumes by itself."""
    state = FakeLab(triangle()).state
    assert cause(replace(state, phase=Phase.HOLD, cause="leader: body not seen for 0.2 s")) == (
        "leader: body not seen for 0.2 s; `start` or `resume` by the operator leads on"
    )
    assert cause(replace(state, phase=Phase.LAND, cause="operator: land")) == "operator: land"
