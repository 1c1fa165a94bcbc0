"""Troubleshooting explains every text by which the programs warn, refuse a command or drop an input."""

import re

import pytest

from drone_agent.autopilots.ardupilot import TEXTS as ARDUPILOT_TEXTS
from drone_agent.autopilots.px4 import TEXTS as PX4_TEXTS
from formation.messages import LawFailure, Rejection
from formation.safety.rules_table import RULES
from tests.docs.manual_pages import MANUAL
from tools.reference import texts
from tools.reference.texts import GAP, normal
from wire.clock_offset import rate_offset_text

PAGES = {page.stem: page.read_text(encoding="utf-8") for page in (MANUAL / "troubleshooting").glob("*.md")}
EXPLAINED = {normal(text) for page in PAGES.values() for text in re.findall(r"`([^`\n]+)`", page)}
AUTOPILOT_TEXTS = [
    text
    for texts in (PX4_TEXTS, ARDUPILOT_TEXTS)
    for text in (
        *texts.arm_rejected, texts.disarm_rejected, texts.mode_rejected, texts.no_position, texts.not_armable,
        texts.stream_lost, texts.pose_lost, texts.battery_low, texts.battery_critical, texts.ground_lost,
    )
]  # fmt: skip


TEXTS = {
    "warning": {s.text for s in texts.warnings()[0]},
    "rule": {rule.fault for rule in RULES},
    "reason of a refused command": {s.text for s in texts.reasons()},
    "reason of a dropped input": {s.text for s in texts.rejected_inputs()},
    "rejected pose": {reason.text for reason in Rejection if reason.text},
    "text of an autopilot": {normal(text) for text in AUTOPILOT_TEXTS if text},
}


@pytest.mark.parametrize("kind", TEXTS)
def test_every_text_is_explained(kind: str) -> None:
    assert TEXTS[kind]
    # A clause of a parameter's is led by its name, a reason by the body's.
    assert [text for text in sorted(TEXTS[kind]) if not {text, f"{GAP} {text}", f"{GAP}: {text}"} & EXPLAINED] == []


def test_every_check_of_the_doctor_is_explained() -> None:
    checks = [name for name in texts.doctor_checks() if GAP not in name]
    assert [check for check in checks if f"`{check}`" not in PAGES["doctor"]] == []


def test_texts_made_elsewhere_are_explained() -> None:
    failure = LawFailure(0, GAP, GAP, GAP, False)
    assert normal(failure.text) in EXPLAINED
    assert re.sub(r"[\d.]+|slower|faster", GAP, rate_offset_text(-0.01)) in EXPLAINED
