"""Pictures of the operator's page: `python -m tools.figures.page_pictures FOLDER`; needs Chromium, drones are fake.

Three drones in formation, twenty, an alarm, a lost connection, a stop that all have latched.
"""

import hashlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image

from tests.free_ports import free_port
from tests.gcs.page.browser import Tab, browser
from tests.gcs.page.flights import page_server

SIZE = (1600, 900)
TAKEN_OF = "taken-of.sha256"
"""Beside the pictures: the hash of the page's files of which they were taken."""


@contextmanager
def ground(folder: Path, followers: int) -> Iterator["subprocess.Popen[bytes]"]:
    """A ground of fake drones, in formation."""
    command = [sys.executable, "-m", "tests.gcs.page.lab", "--followers", str(followers)]
    command += ["--port", str(free_port()), "--lab", str(folder / "lab.toml")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline().strip() == b"ready"
        try:
            yield process
        finally:
            process.kill()


def small(file: Path) -> None:
    """The same in 256 colours: a third of its size, and nobody sees it."""
    Image.open(file).convert("RGB").quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
        file, optimize=True
    )


def say(process: "subprocess.Popen[bytes]", line: str) -> None:
    """Have something happen to the fake lab."""
    assert process.stdin is not None
    process.stdin.write(line.encode() + b"\n")
    process.stdin.flush()


def main(out: Path) -> None:
    """All of them."""
    out.mkdir(parents=True, exist_ok=True)
    for followers in (2, 19):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            lab = folder / "lab.toml"
            with ground(folder, followers) as process, page_server(lab, 1.0) as (url, _), browser(folder) as new_tab:
                tab: Tab = new_tab()
                tab.open(url, *SIZE)
                tab.until("document.querySelector('.phase')?.textContent === 'FORMATION'")
                time.sleep(6.0)
                tab.click(".room")
                tab.run("[...document.querySelectorAll('.alarmhead button')].forEach(one => one.click())")
                time.sleep(1.0)
                if followers > 2:
                    tab.picture(out / "twenty.png")
                else:
                    _incidents(tab, process, out)

    for file in out.glob("[!r]*.png"):  # Rerun's window is taken by hand
        small(file)
    (out / TAKEN_OF).write_text(sources_hash() + "\n", encoding="ascii")


def sources_hash() -> str:
    """A hash of what draws the page: pictures that were taken of another one are out of date."""
    page = Path(__file__).parents[2] / "gcs" / "page"
    files = [page / "drawing.py", page / "viewer.py", *sorted((page / "browser").iterdir())]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()


def _incidents(tab: Tab, process: "subprocess.Popen[bytes]", out: Path) -> None:
    """Three drones, then what may happen to them."""
    tab.picture(out / "three.png")
    say(process, "lab.hidden = {'cf03'}")
    tab.until("document.querySelector('.alarm.bad')")
    time.sleep(1.0)
    tab.picture(out / "alarm.png")
    tab.press(" ", "Space", 32)
    tab.until("document.querySelector('.stopped')?.textContent.startsWith('3 of 3')")
    time.sleep(0.5)
    tab.picture(out / "stopped.png")
    process.kill()
    tab.until("document.querySelector('.lost')?.textContent.includes('NO CONNECTION')")
    time.sleep(2.0)
    tab.picture(out / "lost.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
