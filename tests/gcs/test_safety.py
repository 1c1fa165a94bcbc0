"""An effect that a rule finds is reported with what was known of its cause before it."""

import pytest

from formation.messages import Rejection, Severity
from formation.safety.rules import FaultChange
from formation.safety.rules_table import RULES
from gcs.drones.link_state import DroneLink
from gcs.safety import with_cause
from tests.gcs.link import MS, Drone, a_link, beat
from wire.link_messages import BRIDGE_COMPONENT, StatusText

NOW_NS = 5000 * MS


def _text(rule_name: str, link: DroneLink, rejected: int = 0) -> str:
    rule = next(rule for rule in RULES if rule.name == rule_name)
    return with_cause(FaultChange(0, rule, True, "left"), link, rejected, NOW_NS)


@pytest.fixture
def link() -> DroneLink:
    link = a_link()
    Drone().say(link, beat(), NOW_NS - 100 * MS)
    return link


def test_a_drone_whose_guard_took_over_is_reported_with_the_guards_first_warning(link: DroneLink) -> None:
    guard = Drone(component=BRIDGE_COMPONENT)
    for words in ("Pose rejected, drift: hold", "No pose to land on: coming down level"):
        guard.say(link, StatusText(Severity.CRITICAL, words), NOW_NS - 50 * MS)
    assert _text("rule-not-offboard", link) == "left: not in off-board mode (its guard: Pose rejected, drift: hold)"
    assert _text("rule-battery-low", link) == "left: battery low"
    guard.say(link, StatusText(Severity.INFO, "Setpoints are back"), NOW_NS)
    assert _text("rule-not-offboard", link) == "left: not in off-board mode"


def test_a_drone_that_is_not_heard_has_no_model_mismatch_of_its_own(link: DroneLink) -> None:
    assert _text("rule-model-mismatch", link) == "left: model mismatch"
    silent = a_link()
    Drone().say(silent, beat(), NOW_NS - 700 * MS)
    assert _text("rule-model-mismatch", silent) == "left: model mismatch (nothing is heard of it)"


def test_an_unseen_body_is_reported_with_why_the_mocap_rejects_it(link: DroneLink) -> None:
    assert _text("rule-lost", link) == "left: body not seen for 0.4 s"
    text = "left: body not seen for 0.4 s (the mocap rejects its pose: jumped farther than it can move)"
    assert _text("rule-lost", link, Rejection.JUMP) == text
