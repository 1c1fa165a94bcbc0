"""Faults that are played against the rules: the numbers are those of the failsafe matrix."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from formation.config import LimitsConfig
from formation.messages import Phase
from formation.safety.rules_table import RULES, Own
from gcs.cli.app import app
from gcs.played import FAULTS, PHASES, play

runner = CliRunner()


def test_a_body_that_is_lost_is_held_for_then_released_and_all_land() -> None:
    follows = [
        (act.after_s, act.phase, act.own) for act in play(Phase.FORMATION, next(iter(FAULTS)), 1, LimitsConfig())
    ]
    assert follows == [
        (pytest.approx(0.21), Phase.HOLD, Own.NOTHING),
        (pytest.approx(0.41), Phase.LAND, Own.RELEASE),
        (pytest.approx(6.41), Phase.GROUND, Own.NOTHING),
    ]


def test_every_rule_but_one_of_estimation_is_brought_about_by_some_fault() -> None:
    """A new rule wants a fault here. Model mismatch has no single cause that could be set."""
    acted = {
        act.rule
        for phase in PHASES
        for fault in FAULTS
        for who in (0, 1)
        for act in play(phase, fault, who, LimitsConfig())
    }
    assert {rule.name for rule in RULES} - acted == {"rule-model-mismatch", "rule-long-lost"}


def test_the_page_holds_what_the_command_prints(tmp_path: Path) -> None:
    done = runner.invoke(app, ["rules", "--play", "HOLD", "--json"])
    acts = json.loads(done.stdout)
    page = tmp_path / "rules.html"
    assert runner.invoke(app, ["rules", "--page", str(page)]).exit_code == 0
    assert json.dumps(acts)[1:-1] in page.read_text()
    shown = runner.invoke(app, ["rules", "--play", "HOLD"]).stdout
    assert all(act["text"] in shown for follows in acts.values() for act in follows)
    assert runner.invoke(app, ["rules", "--play", "SOON"]).exit_code == 2
