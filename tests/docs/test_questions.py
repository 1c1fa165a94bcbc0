"""What a lab asks is answered on one page, which a search for the question's words finds among few."""

import re

import pytest

from tests.docs.manual_pages import MANUAL, pages

QUESTIONS = (
    ("Which PX4 parameters take the pose of the cameras?", "EKF2_EV_CTRL 11", "howto/px4-bridge"),
    ("Which UDP port does drone 3 listen on?", "14580 + sysid", "howto/several-drones"),
    ("How do I see the page on a tablet?", "tablet ssh 8470", "howto/page"),
    ("Our cameras are y-up: what do I write?", "axes up motive", "howto/optitrack"),
    ("How do I add a stop button?", "stop_button button device", "howto/stop-button"),
    ("How long may a drone stay armed on the floor?", "armed disarms itself 10 s", "howto/fly"),
    ("What happens when the ground dies?", "ground killing floor", "explanation/safety"),
    ("Which profile do I take for my vehicle?", "profile nearest mass size", "howto/identify-tune"),
    ("What does a released drone do?", "release no more setpoints lands", "glossary"),
    ("How do I hold a flight to numbers in CI?", "require formation_rms_m pytest", "howto/ci"),
    ("Why does it say no fresh pose?", "no fresh pose last seen", "troubleshooting/arming"),
    ("In which unit and frame is a position in the log?", "pos_lab_m_x metres lab", "tutorials/analyse"),
)
MOST_PAGES = 8


@pytest.mark.parametrize(("question", "words", "page"), QUESTIONS)
def test_question_is_answered_on_one_page(question: str, words: str, page: str) -> None:
    texts = {str(p): p.read_text(encoding="utf-8").lower() for p in pages()}
    wanted = [re.compile(re.escape(word.lower())) for word in words.split()]
    found = [name for name, text in texts.items() if all(word.search(text) for word in wanted)]
    assert str(MANUAL / f"{page}.md") in found, question
    assert len(found) <= MOST_PAGES, found
