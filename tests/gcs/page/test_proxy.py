"""A viewer on another machine, by a real browser: it logs in, may only stop, and the ground knows who it is."""

import asyncio
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

import pytest

from formation.config import LabConfig
from formation.messages import OperatorReply, OperatorRequest, Verb
from formation.requests import GCS_NAME
from gcs.security.key_folder import KeyFolder
from gcs.security.page_logins import drop_token
from gcs.security.roles import by_role
from tests.free_ports import free_port
from tests.gcs.page.browser import CHROMIUM, NONE, Tab, browser
from tests.gcs.page.flights import page_server
from tests.gcs.page.proxy import CLIENT, proxy
from tests.gcs.security.lab import LAB
from wire import config_file
from wire.clock import monotonic_ns
from wire.rejections import RejectionLog
from wire.security.protection import protection_of
from wire.transport.zenoh_bus import ZenohBus


@contextmanager
def ground(config: LabConfig, keys: Path) -> Iterator[tuple[list[OperatorRequest], RejectionLog]]:
    """Who answers every request that roles allow; what was asked of it, and what was refused."""
    asked: list[OperatorRequest] = []
    rejections, ready, ended = RejectionLog(), threading.Event(), threading.Event()

    def answer(request: OperatorRequest, reply: Callable[[OperatorReply], None]) -> None:
        asked.append(request)
        reply(OperatorReply(request.id, True, "done"))

    async def serve() -> None:
        bus = await ZenohBus.open(config.link, config.name, protection=protection_of(keys, "ground"))
        bus.serve(GCS_NAME, by_role(config, answer, rejections, monotonic_ns))
        ready.set()
        await asyncio.to_thread(ended.wait)
        await bus.close()

    thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
    thread.start()
    try:
        assert ready.wait(30.0)
        yield asked, rejections
    finally:
        ended.set()
        thread.join(10.0)


def log_in(tab: Tab, url: str, token: str) -> None:
    tab.call("Security.setIgnoreCertificateErrors", ignore=True)  # of an authority that this browser does not know
    tab.open(url)
    tab.until("document.querySelector('input[name=token]')")
    tab.run(f"document.querySelector('input').value = {token!r}; document.querySelector('button').click()")


@pytest.mark.processes
@pytest.mark.skipif(CHROMIUM is None, reason=NONE)
def test_a_viewer_from_elsewhere_logs_in_and_may_only_stop(tmp_path: Path) -> None:
    link = {"zenoh_listen": [f"tls/127.0.0.1:{free_port()}"], "zenoh_connect": []}
    config, file = LabConfig.model_validate(LAB | {"link": link}), tmp_path / "lab.toml"
    file.write_text(config_file.dump(config))
    folder = KeyFolder(config, file)
    folder.make(datetime.now(UTC))
    token = folder.page_token("board", datetime.now(UTC))
    port, behind = free_port(), free_port()
    public = f"https://127.0.0.1:{port}"
    with (
        ground(config, folder.path) as (asked, rejections),
        page_server(file, 1.0, "--public", public, "--public-port", str(behind)) as (loopback, _),
        proxy(folder.path / "page", port, behind),
        browser(tmp_path) as new_tab,
    ):
        tab: Tab = new_tab()
        log_in(tab, public, "not the token")
        tab.until("document.body?.innerText.includes('This token is nobody')")
        log_in(tab, public, token)
        tab.until("document.body?.innerText.includes('board, viewer: may ask for only stop')")
        tab.press("h", "KeyH", 72)
        tab.until("document.body?.innerText.includes('the role viewer of board may not hold')")
        assert not tab.run("document.querySelector('.take')?.offsetParent")
        tab.click("button.stop")
        tab.until("document.body?.innerText.includes('stop: done')")
        here: Tab = new_tab()
        here.open(loopback)  # without a login
        here.until("document.querySelector('button.stop')")
        here.until("document.getElementById('beat')?.textContent > 1")
        here.press(" ", "Space", 32)
        here.until("document.body?.innerText.includes('stop: done')")
        drop_token(folder.path / "page", "board")
        tab.until("document.body?.classList.contains('disconnected')")
    assert [request.verb for request in asked] == [Verb.STOP, Verb.STOP]
    assert asked[0].source == f"page.1 (board at {CLIENT})"
    assert asked[1].source.startswith("page.1 (page of ")
    assert rejections.count == 1
    assert [event.source for event in rejections.due(monotonic_ns())] == [f"page.1 (board at {CLIENT})"]
