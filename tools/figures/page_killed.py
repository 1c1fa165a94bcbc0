"""The operator's page killed in flight, with a viewer on it: does the flight change?

    python -m tools.figures.page_killed --flights 5     # real processes, real time; needs Chromium

In each flight the page's server is killed (SIGKILL) some seconds after the formation has begun. Told is how it ended,
whether its log replays bit by bit, how far off the followers were, and the control cycles that were late in the five
seconds before the kill and after it, with the longest of each.
"""

import argparse
import asyncio
import json
import random
import signal
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from analysis.load import load
from analysis.metrics import summarise
from formation import topics
from formation.messages import LoopTiming
from gcs.replay import replay
from sim import fly
from sim.ports import private_link
from sim.scenario import load as load_scenario
from tests.gcs.page.browser import Tab, browser
from tests.gcs.page.flights import page_server
from wire import config_file
from wire.clock import Clock, monotonic_ns
from wire.logs.mcap_read import read_log

AROUND_NS = 5_000_000_000


def flight(folder: Path, after_s: float, speed: float) -> dict[str, Any]:
    """One flight, its page killed after_s into the formation."""
    scenario = load_scenario("triangle_circle")
    with private_link("udp", (1, 2, 3)) as link:
        scenario = scenario.model_copy(update={"lab": scenario.lab.model_copy(update={"link": link})})
        files = fly.Files(folder)
        files.lab.write_text(config_file.dump(scenario.lab))
        clock = Clock(speed)
        with page_server(files.lab, speed) as (url, server), browser(folder) as new_tab:
            tab: Tab = new_tab()
            tab.open(url)
            forming_s: list[float] = []
            killed_ns: list[int] = []

            def watch(t_s: float, phase: str) -> None:
                if phase == "FORMATION":
                    forming_s.append(t_s)
                if forming_s and not killed_ns and t_s - forming_s[0] > after_s:
                    server.send_signal(signal.SIGKILL)
                    killed_ns.append(clock.monotonic_ns())

            begun_ns = monotonic_ns()
            outcome = asyncio.run(fly.fly(scenario, 1, files, watch, clock=clock))
            took_s = round((monotonic_ns() - begun_ns) * 1e-9)
            told = {"outcome": outcome.result, "reason": outcome.reason, "took_s": took_s}
            if not killed_ns:  # a machine that starves the simulators says nothing of the page
                return told
            dead = server.wait(10.0) == -signal.SIGKILL
    log, summary = read_log(files.mcap), summarise(load(files.mcap))
    cycles = [(entry.t_ns, entry.message) for entry in log.entries if entry.topic is topics.TIMING]
    return told | {
        "killed": dead,
        "bit_identical": replay(read_log(files.mcap)).identical,
        "formation_rms_mm": round(1e3 * (summary.formation_rms_m or 0.0), 2),
        "before": _told(m for t, m in cycles if -AROUND_NS <= t - killed_ns[0] < 0),
        "after": _told(m for t, m in cycles if 0 <= t - killed_ns[0] < AROUND_NS),
    }


def _told(cycles: Iterable[LoopTiming]) -> dict[str, float]:
    """Of some control cycles: how many, how many late, the longest."""
    told = list(cycles)
    worst_s = max((one.latency_s for one in told), default=0.0)
    return {"cycles": len(told), "late": sum(one.late for one in told), "worst_ms": round(1e3 * worst_s, 1)}


def main() -> None:
    """The command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--flights", type=int, default=5)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    drawn = random.Random(given.seed)
    for _ in range(given.flights):
        with tempfile.TemporaryDirectory() as name:
            print(json.dumps(flight(Path(name), drawn.uniform(6.0, 18.0), given.speed)), flush=True)


if __name__ == "__main__":
    main()
