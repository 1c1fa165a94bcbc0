"""The page in a real browser: a flight by clicks, two viewers, a server killed in flight, STOP by the space bar."""

from pathlib import Path

import pytest

from gcs.replay import replay
from sim.ports import private_link
from sim.scenario import load
from tests.gcs.page.browser import CHROMIUM, NONE, Tab
from tests.gcs.page.flights import page_server, with_browser
from wire.logs.mcap_read import read_log

SPEED = 0.5


def phase(tab: Tab, name: str) -> None:
    tab.until(f"document.querySelector('.phase')?.textContent === '{name}'")


@pytest.mark.processes
@pytest.mark.flights
@pytest.mark.skipif(CHROMIUM is None, reason=NONE)
def test_a_flight_is_flown_by_clicks_and_stopped_by_the_space_bar(tmp_path: Path) -> None:
    def act(url: str, server, new_tab) -> None:
        tab: Tab = new_tab()
        tab.open(url)
        phase(tab, "GROUND")
        tab.click("#do-arm")
        phase(tab, "ARMED")
        tab.click("#do-takeoff")
        phase(tab, "HOLD")
        assert tab.run("document.querySelectorAll('svg .drone').length") == 6  # three, in two views
        tab.click("#do-start")
        phase(tab, "FORMATION")

        other: Tab = new_tab()
        other.open(url)
        other.until("document.body?.innerText.includes('Read-only: viewer 1 has the control')")
        assert other.run("document.querySelector('#do-land').disabled")
        other.run("[...document.querySelectorAll('.take button')][0].click()")
        tab.until("document.body?.innerText.includes('viewer 2 has taken the control over from viewer 1')")
        other.press("h", "KeyH", 72)
        phase(tab, "HOLD")
        other.click("#do-start")
        phase(tab, "FORMATION")

        server.kill()  # in flight: the ground flies on, and another page takes over
        tab.until("document.body?.classList.contains('disconnected')")
        with page_server(tmp_path / "flight" / "lab.toml", SPEED) as (again, _):
            tab.open(again)
            phase(tab, "FORMATION")
            other.open(again)
            other.until("document.body?.innerText.includes('Read-only: viewer 1 has the control')")
            tab.click("#do-land")
            phase(other, "LAND")
            phase(other, "GROUND")
            other.press(" ", "Space", 32)  # a stop is everybody's, also of who only looks on
            phase(other, "STOPPED")
            latched = "'3 of 3 drones report their motors off'"
            other.until(f"document.querySelector('.stopped').textContent.startsWith({latched})")

    scenario = load("triangle_line")
    with private_link("udp", (1, 2, 3)) as link:
        scenario = scenario.model_copy(update={"lab": scenario.lab.model_copy(update={"link": link})})
        with_browser(scenario, tmp_path / "flight", SPEED, act)
    assert replay(read_log(tmp_path / "flight" / "flight.mcap")).identical
