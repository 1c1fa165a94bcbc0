"""Troubleshooting explains every text by which the programs warn, refuse a command or drop an input."""

import re

import manual_texts
import pytest
from manual_texts import GAP, LoggedText, PassedOn, normal

from drone_agent.autopilots.ardupilot import TEXTS as ARDUPILOT_TEXTS
from drone_agent.autopilots.px4 import TEXTS as PX4_TEXTS
from formation.messages import LawFailure
from formation.rejection import Rejection
from formation.safety.rules_table import RULES
from tests.docs.manual_pages import MANUAL
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
KNOWN_ORIGINS = {
    "texts.": "the autopilots' own texts",
    "words, fault": "the autopilots' own texts",
    "failure.text": "LawFailure",
    "link.name, text": "gcs.drones.checks, among the reasons",
    "rate_offset_text(": "wire.clock_offset",
    "'flight', text": "gcs.landing, named by `told to land by itself`",
    "source, after": "HostReport: log, stop button",
    "name, _words(": "what is dropped, below",
}
"""Expressions by which a warning passes on the words of somebody else, and whose."""


def found() -> list[LoggedText]:
    return manual_texts.warnings()[0]


@pytest.mark.parametrize("text", sorted({s.text for s in found()}))
def test_warning_is_explained(text: str) -> None:
    assert text in EXPLAINED


@pytest.mark.parametrize("text", [rule.fault for rule in RULES])
def test_rule_is_explained(text: str) -> None:
    assert text in EXPLAINED


@pytest.mark.parametrize("text", sorted({s.text for s in manual_texts.reasons()}))
def test_reason_of_a_refused_command_is_explained(text: str) -> None:
    assert {text, f"{GAP} {text}"} & EXPLAINED  # a clause of a parameter's is led by its name


@pytest.mark.parametrize("text", sorted({s.text for s in manual_texts.rejected_inputs()}))
def test_reason_of_a_dropped_input_is_explained(text: str) -> None:
    assert text in EXPLAINED


@pytest.mark.parametrize("text", [reason.text for reason in Rejection if reason.text])
def test_rejected_pose_is_explained(text: str) -> None:
    assert text in EXPLAINED


@pytest.mark.parametrize("check", [name for name in manual_texts.doctor_checks() if GAP not in name])
def test_check_of_the_doctor_is_explained(check: str) -> None:
    assert f"`{check}`" in PAGES["doctor"]


@pytest.mark.parametrize("text", sorted({normal(text) for text in AUTOPILOT_TEXTS if text}))
def test_text_of_an_autopilot_is_explained(text: str) -> None:
    assert text in EXPLAINED


def test_texts_made_elsewhere_are_explained() -> None:
    failure = LawFailure(0, GAP, GAP, GAP, False)
    assert normal(failure.text) in EXPLAINED
    assert re.sub(r"[\d.]+|slower|faster", GAP, rate_offset_text(-0.01)) in EXPLAINED


@pytest.mark.parametrize("passed", manual_texts.warnings()[1], ids=lambda passed: passed.expression)
def test_a_passed_on_warning_has_a_known_origin(passed: PassedOn) -> None:
    assert any(part in passed.expression for part in KNOWN_ORIGINS) or "natnet/client" in passed.file


def test_there_are_forty_rows() -> None:
    rows = sum(len(re.findall(r"^\| ", page, re.MULTILINE)) for page in PAGES.values())
    assert rows >= 150
