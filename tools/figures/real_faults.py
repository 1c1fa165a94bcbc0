"""Flies real processes, does them harm, and judges by the truth that the simulated drones publish on the bus.

    python -m tools.figures.real_faults                                 # everything, over both links: hours
    python -m tools.figures.real_faults ground-killed --link udp --runs 200 --speed 1.0

Of each case and link: how many flights were contained, and the worst figures. A flight whose simulators were starved of
time says nothing and is flown again as another. Exit code 1 if anything was not contained.
"""

import argparse
import asyncio
import json
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path

import numpy as np

from sim import lockstep
from sim.processes import ProcessDied
from tools.figures.real_cases import CASES, Case, Run, small_file_system
from tools.figures.real_flight import HEIGHT_M, LINKS, Hung, LinkKind, Setting, room
from wire.clock import Clock

SPEED = 0.35
PER_ROOM = 20
"""Flights by the same processes, but for what is killed."""
STARVED_MOST = 10


@contextmanager
def setting_of(case: Case, link: LinkKind, clock: Clock, folder: Path, height_m: float = HEIGHT_M) -> Iterator[Setting]:
    """Where the case's flights are flown."""
    with ExitStack() as stack:
        logs = folder / "logs" if case.logs_apart else None
        if logs is not None:
            stack.enter_context(small_file_system(logs))
        yield Setting(link, clock, case.bridged, case.relayed, case.rate_hz, logs, case.circle_s, height_m)


class Flights:
    """The flights of one case over one link; `runs` as they come."""

    def __init__(self, name: str, link: LinkKind, count: int, seed: int, clock: Clock) -> None:
        self.name, self.link, self.count, self.seed = name, link, count, seed
        self.runs: list[Run] = []
        self.starved = 0
        self._clock = clock

    async def fly(self, folder: Path) -> None:
        """All of them, in one room after another."""
        case = CASES[self.name]
        for number in range(self.count + STARVED_MOST):
            if len(self.runs) >= self.count or self.starved > STARVED_MOST:
                return
            with setting_of(case, self.link, self._clock, folder / str(number)) as setting:
                await self._in_one_room(case, setting, folder / str(number))

    async def _in_one_room(self, case: Case, setting: Setting, folder: Path) -> None:
        alone = case.logs_apart
        try:
            async with room(setting, folder, self.seed) as here:
                for _ in range(1 if alone else PER_ROOM):
                    if len(self.runs) >= self.count:
                        return
                    luck = [self.seed, list(CASES).index(self.name), len(self.runs) + self.starved]
                    run = await case.fly(here, np.random.default_rng(luck))
                    self.runs.append(run)
                    print(f"{self.name} {self.link} {len(self.runs)}: {_line(run)}", file=sys.stderr, flush=True)
        except ProcessDied as died:
            if not died.starved:
                raise
            self.starved += 1
            print(f"{self.name} {self.link}: {died}", file=sys.stderr, flush=True)
        except Hung as hung:
            self.runs.append(Run("not flown", "", 0.0, 0.0, 0.0, 0.0, (str(hung),)))
            print(f"{self.name} {self.link}: {hung}", file=sys.stderr, flush=True)

    def summary(self) -> dict[str, object]:
        """Its figures: how many, how many contained, the worst of each, and what failed."""
        failed = [run for run in self.runs if run.reasons]
        worst = {
            key: round(max((getattr(run, key) for run in self.runs), default=0.0), 3)
            for key in ("seconds", "height_m", "drift_m", "impact_m_s")
        }
        extra = {
            key: max(run.extra[key] for run in self.runs if key in run.extra) for run in self.runs for key in run.extra
        }
        return {
            "case": self.name, "link": self.link, "runs": len(self.runs), "contained": len(self.runs) - len(failed),
            "starved": self.starved, **worst, **extra, "failed": [asdict(run) for run in failed],
        }  # fmt: skip


def _line(run: Run) -> str:
    ends = "; ".join(run.reasons) or "contained"
    figures = f"off after {run.seconds:.2f} s, drift {run.drift_m:.2f} m, {run.impact_m_s:.2f} m/s"
    return f"{run.what} in {run.phase}: {ends}, {figures}"


def fly(names: Sequence[str], links: Sequence[LinkKind], runs: int | None, seed: int, speed: float) -> list[Flights]:
    """Fly the cases over the links that each is about."""
    lockstep.warm_up_all()
    told = []
    for name in names:
        for link in (link for link in links if link in CASES[name].links):
            flights = Flights(name, link, runs or CASES[name].count, seed, Clock(speed))
            with tempfile.TemporaryDirectory() as folder:
                asyncio.run(flights.fly(Path(folder)))
            told.append(flights)
    return told


def main() -> int:
    """The program."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("case", nargs="*", help="which alone: " + ", ".join(CASES))
    parser.add_argument("--link", choices=LINKS, action="append", help="over which alone")
    parser.add_argument(
        "--runs", type=int, help="of each case and link; without it 200 kills of the ground, fewer else"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--speed", type=float, default=SPEED, help="of the clock of all processes")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    if unknown := [name for name in asked.case if name not in CASES]:
        parser.error(f"no case {unknown[0]!r}; there are: {', '.join(CASES)}")
    flown = fly(asked.case or tuple(CASES), asked.link or LINKS, asked.runs, asked.seed, asked.speed)
    summaries = [flights.summary() for flights in flown]
    if asked.json:
        print(json.dumps(summaries, indent=2))
    for summary in summaries if not asked.json else ():
        print(", ".join(f"{key} {value}" for key, value in summary.items() if key != "failed"))
    return 1 if any(summary["failed"] or not summary["runs"] for summary in summaries) else 0


if __name__ == "__main__":
    sys.exit(main())
