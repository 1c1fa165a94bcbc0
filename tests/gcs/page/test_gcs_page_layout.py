"""Where things are on the page, in a real browser as wide as a desk's, a tablet's and a phone's."""

import subprocess
import sys
import time
from pathlib import Path

import pytest
from free_ports import free_port
from page_browser import CHROMIUM, NONE, Tab, browser
from page_flights import page_server

HERE = Path(__file__).parent


def box(tab: Tab, selector: str) -> tuple[float, float, float, float]:
    """Left, top, right, bottom, px."""
    found = tab.run(
        f"(() => {{ const r = document.querySelector({selector!r}).getBoundingClientRect(); "
        "return [r.left, r.top, r.right, r.bottom]; })()"
    )
    return found[0], found[1], found[2], found[3]


def apart(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one[2] <= other[0] or other[2] <= one[0] or one[3] <= other[1] or other[3] <= one[1]


@pytest.mark.processes
@pytest.mark.skipif(CHROMIUM is None, reason=NONE)
def test_nothing_is_covered_and_everything_can_be_reached(tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    ground = [sys.executable, str(HERE / "page_lab.py"), "--port", str(free_port()), "--lab", str(lab), "--fly"]
    with (
        subprocess.Popen(ground, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process,
        browser(tmp_path) as new_tab,
    ):
        try:
            assert process.stdin is not None
            assert process.stdout is not None
            assert process.stdout.readline() == "ready\n"
            with page_server(lab, 1.0) as (url, _):
                process.stdin.write('lab.hidden.add("cf02")\n')
                process.stdin.flush()
                for width, height in ((1400, 900), (1180, 820), (390, 844)):
                    tab: Tab = new_tab()
                    tab.open(url, width, height)
                    tab.until("document.querySelector('.alarm')")
                    alarm, stop = box(tab, ".alarm"), box(tab, "button.stop")
                    assert apart(alarm, box(tab, ".table"))
                    assert alarm[3] <= height
                    assert apart(stop, box(tab, ".phase"))
                    assert tab.run("document.documentElement.scrollWidth") <= width
                    tab.run("document.querySelector('.table').scrollLeft = 10000")
                    assert box(tab, "th:last-child")[2] <= width
                tab.run("window.scrollTo(0, 100000)")
                time.sleep(0.2)
                assert box(tab, "button.stop")[1] >= 0.0
                assert apart(box(tab, "button.stop"), box(tab, ".phase"))
                assert box(tab, ".phase")[1] >= 0.0
        finally:
            process.kill()
