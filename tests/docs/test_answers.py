"""What users ask is found by one search in the manual, and what the answers state holds."""

import itertools
import re
import tomllib
from math import dist

import pytest

from tests.docs.manual_pages import MANUAL, ROOT

PAGES = {
    str(path.relative_to(MANUAL).with_suffix("")): path.read_text(encoding="utf-8").lower()
    for path in MANUAL.rglob("*.md")
    if "_build" not in path.parts
}
QUESTIONS = {
    "wire jetson": ("howto/companion", "/dev/ttyths1"),
    "raspberry pi uart": ("howto/companion", "/dev/ttyama0"),
    "marker layouts": ("howto/rigid-body", "| drone | marker 1 |"),
    "cameras wi-fi": ("explanation/time", "only drones belong on wi-fi"),
    "spare drone": ("howto/companion", "gcs replace left --sysid 7"),
    "several rooms": ("howto/rooms", 'include = "hall.toml"'),
    "space drones above": ("howto/downwash", "spacing aside helps"),
    "trust simulator": ("explanation/trust", "simulator"),
    "matlab": ("tutorials/analyse", "```matlab"),
    "cite": ("howto/publish", "citation.cff"),
    "tune gains": ("howto/identify-tune", "gcs-sim tune"),
    "crazyflie profile": ("reference/profiles-presets", "crazyflie_27g"),
    "battery low": ("reference/lab-file", "`battery_low_share`"),
    "swap battery": ("howto/companion", "battery_empty_share"),
    "nokov": ("howto/nokov", 'source = "nokov"'),
    "gamepad": ("howto/fly", "gcs fly gamepad"),
    "emergency stop": ("howto/fly", "gcs stop"),
    "pilot takes over": ("howto/fly", "## a pilot takes over"),
    "firewall": ("howto/companion", "ufw allow"),
    "animation": ("howto/publish", "--gif"),
    "tested python": ("reference/tested", "3.14"),
}
"""What is typed into the search, and the page and words that answer it."""
IN_TITLE, IN_TEXT, IN_PART = 15, 5, 2  # Sphinx's own points (searchtools.js)


def search(words: str) -> list[str]:
    """The pages that have every word, or a word it is a part of; best first, as Sphinx counts, the shorter before."""
    scores = {}
    for name, text in PAGES.items():
        titles = " ".join(re.findall(r"^#+ (.*)$", text, re.MULTILINE))
        found = []
        for word in words.split():
            in_title = re.search(rf"\b{re.escape(word)}", titles) is not None
            whole = re.search(rf"\b{re.escape(word)}s?\b", text) is not None
            found.append(IN_TITLE if in_title else IN_TEXT if whole else IN_PART if word in text else 0)
        if all(found):
            scores[name] = (sum(found), -len(text))
    return sorted(scores, key=scores.__getitem__, reverse=True)


@pytest.mark.parametrize("words", QUESTIONS)
def test_a_question_is_answered_by_one_search(words: str) -> None:
    page, answer = QUESTIONS[words]
    assert page in search(words)[:3]
    assert answer in PAGES[page]


def test_no_marker_layout_is_like_another_or_like_itself_from_another_side() -> None:
    rows = re.findall(r"^\| (\d) ((?:\| -?\d+, -?\d+, \d+ ){4})\|$", PAGES["howto/rigid-body"], re.MULTILINE)
    drones = [[tuple(map(int, marker.split(","))) for marker in row.strip("| ").split("|")] for _, row in rows]
    assert len(drones) == 4
    pairs = list(itertools.combinations(range(4), 2))
    same = tuple(range(4))
    for one, other in itertools.combinations_with_replacement(drones, 2):
        for order in itertools.permutations(same):
            differ_mm = max(abs(dist(one[i], one[j]) - dist(other[order[i]], other[order[j]])) for i, j in pairs)
            assert differ_mm >= 20.0 or (one is other and order == same)


def test_the_versions_tested_are_those_that_are_locked_and_declared() -> None:
    table = PAGES["reference/tested"]
    lock = (ROOT / "requirements.txt").read_text(encoding="utf-8")
    locked = dict(re.findall(r"^(numba|eclipse-zenoh|mavsdk)==([\d.]+)", lock, re.MULTILINE))
    assert len(locked) == 3
    assert all(f"| {version} |" in table for version in locked.values())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    pythons = [name.split()[-1] for name in project["classifiers"] if "Python :: 3." in name]
    assert f"| python | {', '.join(pythons)} |" in table
