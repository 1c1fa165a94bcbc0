"""A real browser without a window: Chromium, driven by its own DevTools protocol over a socket."""

import base64
import itertools
import json
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), None
)
NONE = "no Chromium here: apt-get install chromium"
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars", "--no-first-run",
    "--disable-extensions", "--disable-background-networking", "--remote-debugging-port=0",
)  # fmt: skip
PATIENCE_S = 60.0


class Tab:
    """One page in the browser."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._ids = itertools.count(1)

    def call(self, method: str, **given: Any) -> Any:
        """One command of the protocol, and its answer."""
        asked = next(self._ids)
        self._socket.send(json.dumps({"id": asked, "method": method, "params": given}))
        while True:
            told = json.loads(self._socket.recv(timeout=PATIENCE_S))
            if told.get("id") == asked:
                assert "error" not in told, told
                return told["result"]

    def run(self, script: str) -> Any:
        """What the script evaluates to."""
        told = self.call("Runtime.evaluate", expression=script, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in told, told
        return told["result"].get("value")

    def open(self, url: str, width: int = 1920, height: int = 1080) -> None:
        """Go there."""
        self.resize(width, height)
        self.call("Page.enable")
        self.call("Page.navigate", url=url)

    def resize(self, width: int, height: int = 1080) -> None:
        """Make the window so large, pixels."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def until(self, script: str, patience_s: float = PATIENCE_S) -> Any:
        """Wait until the script evaluates to something."""
        end = time.monotonic() + patience_s
        while not (value := self.run(f"(() => {{ const v = {script}; return v instanceof Node ? true : v; }})()")):
            assert time.monotonic() < end, f"{script}: not within {patience_s:g} s; the page: {self.text()[:1500]}"
            time.sleep(0.05)
        return value

    def text(self) -> str:
        """All words on the page."""
        return str(self.run("document.body?.innerText"))

    def click(self, selector: str) -> None:
        """With the mouse, in its middle, once it can be clicked and no longer moves."""
        middle = (
            f"(() => {{ const e = document.querySelector({selector!r}); if (!e || e.disabled || "
            "e.classList.contains('disabled')) return null; const r = e.getBoundingClientRect(); "
            "return [r.x + r.width / 2, r.y + r.height / 2]; })()"
        )
        at = None
        while at != (at := self.until(middle)):
            time.sleep(0.2)
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=at[0], y=at[1], button="left", clickCount=1)

    def press(self, key: str, code: str, number: int) -> None:
        """A key, down and up."""
        for kind in ("rawKeyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, code=code, windowsVirtualKeyCode=number)

    def picture(self, file: Path) -> None:
        """What is to be seen now, as PNG."""
        file.write_bytes(base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"]))


@contextmanager
def browser(folder: Path) -> Iterator[Any]:
    """A running browser: call it for another tab."""
    assert CHROMIUM is not None
    command = [CHROMIUM, *FLAGS, f"--user-data-dir={folder / 'profile'}", "about:blank"]
    with (folder / "chromium.log").open("wb") as log, subprocess.Popen(command, stderr=log, stdout=log) as process:
        try:
            with ExitStack() as sockets:
                port = _port(folder / "profile" / "DevToolsActivePort", process)

                def tab() -> Tab:
                    request = urllib.request.Request(f"http://127.0.0.1:{port}/json/new?about:blank", method="PUT")
                    with urllib.request.urlopen(request) as answer:
                        url = json.load(answer)["webSocketDebuggerUrl"]
                    return Tab(sockets.enter_context(connect(url, max_size=None)))

                yield tab
        finally:
            process.terminate()
            process.wait(10.0)


def _port(file: Path, process: "subprocess.Popen[bytes]") -> int:
    end = time.monotonic() + PATIENCE_S
    while not (file.exists() and file.read_text().strip()):
        assert process.poll() is None, "the browser has ended"
        assert time.monotonic() < end, "the browser does not start"
        time.sleep(0.05)
    return int(file.read_text().split()[0])
