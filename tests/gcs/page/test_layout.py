"""Where things are on the page, in a real browser as wide as a desk's, a tablet's and a phone's."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.free_ports import free_port
from tests.gcs.page.browser import CHROMIUM, NONE, Tab, browser
from tests.gcs.page.flights import page_server

ROOT = Path(__file__).parents[3]


def box(tab: Tab, selector: str) -> tuple[float, float, float, float]:
    """Left, top, right, bottom, px."""
    found = tab.run(
        f"(() => {{ const r = document.querySelector({selector!r}).getBoundingClientRect(); "
        "return [r.left, r.top, r.right, r.bottom]; })()"
    )
    return found[0], found[1], found[2], found[3]


def apart(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]


@contextmanager
def flying_page(folder: Path) -> Iterator[tuple[str, Callable[[], Tab], Callable[[str], None]]]:
    """A page of fake drones in formation: its address, new tabs, and what has a line of Python run upon `lab`."""
    lab = folder / "lab.toml"
    ground = [sys.executable, "-m", "tests.gcs.page.lab", "--port", str(free_port()), "--lab", str(lab)]
    with (
        subprocess.Popen(ground, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process,
        browser(folder) as new_tab,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        stdin = process.stdin

        def have(line: str) -> None:
            stdin.write(line + "\n")
            stdin.flush()

        try:
            assert process.stdout.readline() == "ready\n"
            with page_server(lab, 1.0) as (url, _):
                yield url, new_tab, have
        finally:
            process.kill()


@pytest.mark.processes
@pytest.mark.skipif(CHROMIUM is None, reason=NONE)
def test_everything_can_be_reached_and_what_drones_say_is_text(tmp_path: Path) -> None:
    """An alarm of theirs goes once it is acknowledged, by a request to the ground."""
    markup = "<img src=data:, onerror=window.hit=1>"
    with flying_page(tmp_path) as (url, new_tab, have):
        tab: Tab = new_tab()
        tab.open(url)
        tab.until("document.querySelector('.phase')?.textContent === 'FORMATION'")
        imports = "from formation.messages import Severity; from wire.link_messages import StatusText"
        have(f"{imports}; lab.drones[2]._say(StatusText(Severity.ERROR, {markup!r}))")
        tab.until(f"document.querySelector('.alarms').textContent.includes({json.dumps(markup)})")
        assert tab.run("document.querySelectorAll('.alarms img').length") == 0
        tab.run(f"document.body.insertAdjacentHTML('beforeend', {json.dumps(markup)})")
        time.sleep(0.3)
        assert tab.run("document.querySelectorAll('body > img').length") == 1
        assert tab.run("window.hit === undefined")
        tab.run("[...document.querySelectorAll('.alarmhead button')][0].click()")
        tab.until("!document.querySelector('.alarms .alarm')")
        tab.until("document.querySelector('.answer').textContent.startsWith('acknowledge: ')")

        have('lab.hidden.add("cf03")')
        for width, height in ((1400, 900), (1180, 820), (390, 844)):
            tab.open(url, width, height)
            tab.until("document.querySelector('.alarm')")
            assert apart(box(tab, ".alarm"), box(tab, ".table"))
            assert box(tab, ".alarm")[3] <= height
            assert apart(box(tab, "button.stop"), box(tab, ".phase"))
            assert tab.run("document.documentElement.scrollWidth") <= width
        tab.run("window.scrollTo(0, 100000)")
        time.sleep(0.2)
        assert box(tab, "button.stop")[1] >= 0.0
