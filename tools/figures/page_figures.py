"""What the page costs, and how long a stop takes from outside, on this machine's clock.

    python -m tools.figures.page_figures stop-page --count 200      # space bar in a headless Chromium
    python -m tools.figures.page_figures stop-command --count 50    # `gcs stop`, from the start of its process
    python -m tools.figures.page_figures load --followers 39        # of the page's server, one viewer, 10 Hz

The ground is a GcsCore on a real bus with fake drones behind it, which cut their motors when they are told: a link's
way and an autopilot's are not in the figures of a stop.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from tests.gcs.page.browser import Tab, browser
from tests.gcs.page.flights import page_server
from tools.figures.page_pictures import ground

LOAD_S = 20.0


def figures(taken_ms: list[float]) -> dict[str, float]:
    """Of all stops, ms."""
    p50, p99, most = np.percentile(taken_ms, (50, 99, 100))
    return {"stops": len(taken_ms), "p50_ms": round(p50, 1), "p99_ms": round(p99, 1), "most_ms": round(most, 1)}


def stopped_ns(process: "subprocess.Popen[bytes]") -> int:
    """When the ground stopped next, as it prints it, monotonic."""
    if process.stdout is None:
        raise ValueError("the ground's output is not read")
    return int(process.stdout.readline())


def stop_page(folder: Path, count: int) -> dict[str, float]:
    """By the space bar."""
    lab, taken = folder / "lab.toml", []
    with ground(folder, 2, "--anew") as process, page_server(lab, 1.0) as (url, _), browser(folder) as new_tab:
        tab: Tab = new_tab()
        tab.open(url)
        tab.until("document.querySelector('.phase')?.textContent === 'GROUND'")
        for _ in range(count):
            time.sleep(0.3)
            begun_ns = time.monotonic_ns()
            tab.press(" ", "Space", 32)
            taken.append((stopped_ns(process) - begun_ns) * 1e-6)
    return figures(taken)


def stop_command(folder: Path, count: int) -> dict[str, float]:
    """By `gcs stop`."""
    taken = []
    with ground(folder, 2, "--anew") as process:
        for _ in range(count):
            begun_ns = time.monotonic_ns()
            subprocess.run(
                [sys.executable, "-m", "gcs", "stop", "--lab", str(folder / "lab.toml")],
                check=True,
                capture_output=True,
            )
            taken.append((stopped_ns(process) - begun_ns) * 1e-6)
    return figures(taken)


def load(folder: Path, followers: int) -> dict[str, float]:
    """CPU of the page's server in share of a core, with one viewer that draws it all."""
    lab = folder / "lab.toml"
    with ground(folder, followers, "--again") as _, page_server(lab, 1.0) as (url, server), browser(folder) as new_tab:
        tab: Tab = new_tab()
        tab.open(url)
        tab.until("document.querySelector('.phase')?.textContent === 'FORMATION'")
        time.sleep(5.0)
        beats, begun_s, spent_s = int(tab.run(BEAT)), time.monotonic(), _cpu_s(server.pid)
        time.sleep(LOAD_S)
        passed_s = time.monotonic() - begun_s
        spent_s = _cpu_s(server.pid) - spent_s
        drawn_hz = (int(tab.run(BEAT)) - beats) / passed_s
    return {"drones": followers + 1, "drawn_hz": round(drawn_hz, 2), "core_share": round(spent_s / passed_s, 3)}


BEAT = "document.querySelector('#beat').textContent"


def _cpu_s(pid: int) -> float:
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("what", choices=("stop-page", "stop-command", "load"))
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--followers", type=int, default=39)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        match given.what:
            case "stop-page":
                told = stop_page(folder, given.count)
            case "stop-command":
                told = stop_command(folder, given.count)
            case _:
                told = load(folder, given.followers)
    print(json.dumps(told))


if __name__ == "__main__":
    main()
