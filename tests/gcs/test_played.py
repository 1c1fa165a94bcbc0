"""Faults that are played against the rules: the numbers are those of the failsafe matrix."""

import json
import re

import pytest
from typer.testing import CliRunner

from formation.config import LimitsConfig
from formation.messages import Phase
from formation.safety.rules_table import RULES, Own
from gcs.cli.app import app
from gcs.played import FAULTS, play

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


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    """All faults in all phases, of the leader and of a follower, played once."""
    path = tmp_path_factory.mktemp("rules") / "rules.html"
    assert runner.invoke(app, ["rules", "--page", str(path)]).exit_code == 0
    return path.read_text()


def test_every_rule_but_one_of_estimation_is_brought_about_by_some_fault(page: str) -> None:
    """A new rule wants a fault here. Model mismatch has no single cause that could be set."""
    acted = set(re.findall(r'"rule": "([^"]+)"', page))
    assert {rule.name for rule in RULES} - acted == {"rule-model-mismatch", "rule-long-lost"}


def test_the_page_holds_what_the_command_prints(page: str) -> None:
    done = runner.invoke(app, ["rules", "--play", "HOLD", "--json"])
    acts = json.loads(done.stdout)
    assert json.dumps(acts)[1:-1] in page
    shown = runner.invoke(app, ["rules", "--play", "HOLD"]).stdout
    assert all(act["text"] in shown for follows in acts.values() for act in follows)
    assert runner.invoke(app, ["rules", "--play", "SOON"]).exit_code == 2
