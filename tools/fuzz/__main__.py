"""Inputs of any content to everything that reads them: `python -m tools.fuzz [TARGET ...]`, or all of them.

Nothing may raise, which would have ended a process; no camera system's packet may take longer than STALLED_S; and now
and then each target that has a probe must take a sound input. Exit code 1 for any fault, which is
reported with the number of its input.
"""

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from math import inf
from types import MappingProxyType
from typing import Protocol

from tools.fuzz import cameras, flight, logs
from tools.fuzz.draw import Draw

STALLED_S = 0.25
"""Of CPU: an input that keeps a loop longer than this has stalled it, however slow the machine."""
SHOWN = 20


class Target(Protocol):
    """What is fuzzed. It may have a `probe`, as well: empty where a sound input is taken now, else what is wrong."""

    def feed(self) -> None:
        """Draw an input and have it read."""


@dataclass(frozen=True, slots=True)
class Row:
    """A target: how it is made, how much CPU an input may take, and after how many inputs it must take a sound one."""

    make: Callable[[Draw, Counter[str]], Target]
    most_cpu_s: float = inf
    probe_every: int = 64
    share: float = 1.0
    """Of the inputs that are asked for: a whole file takes as long as a hundred datagrams."""


TARGETS: Mapping[str, Row] = MappingProxyType(
    {
        "frames": Row(flight.Frames),
        "ground": Row(flight.Ground),
        "agent": Row(flight.Agent),
        "bridge": Row(partial(flight.Bridge, serial=False)),
        "serial-bridge": Row(partial(flight.Bridge, serial=True)),
        "crazyflie": Row(flight.Crazyflie, probe_every=1024),
        "page": Row(flight.Page),
        "live": Row(flight.LiveLog),
        "import": Row(logs.Imports, share=0.01),
        "natnet": Row(cameras.NatNetCamera, STALLED_S, probe_every=1024),
        "ros2": Row(cameras.Ros2Camera, STALLED_S),
        **{source: Row(partial(cameras.TcpCamera, source=source), STALLED_S) for source in cameras.SERVERS},
    }
)


@dataclass(slots=True)
class Outcome:
    """How it went: what the target counted, and what raised, stalled or was locked out, in words."""

    counts: Counter[str] = field(default_factory=Counter)
    worst_cpu_s: float = 0.0
    faults: list[str] = field(default_factory=list)


def fuzz(name: str, count: int, seed: int) -> Outcome:
    """That many inputs to a target, or its share of them."""
    row, draw, outcome = TARGETS[name], Draw(seed), Outcome()
    target = row.make(draw, outcome.counts)
    for k in range(round(row.share * count)):
        began_s = time.thread_time()
        try:
            target.feed()
            spent_s = time.thread_time() - began_s
            outcome.worst_cpu_s = max(outcome.worst_cpu_s, spent_s)
            fault = f"took {spent_s:.2f} s of CPU" if spent_s > row.most_cpu_s else ""
            if k % row.probe_every == 0:
                fault = fault or getattr(target, "probe", str)()
        except Exception as error:  # noqa: BLE001 - whatever it is, is what is looked for
            fault = f"{type(error).__name__}: {error}"
            target = row.make(draw, outcome.counts)
        if fault:
            outcome.faults.append(f"{name}, input {k} of seed {seed}: {fault}")
    return outcome


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="TARGET", help=f"{', '.join(TARGETS)}; without it all of them")
    parser.add_argument("--count", type=int, default=1_000_000, help="inputs to each")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if unknown := set(options.targets) - set(TARGETS):
        parser.error(f"no target {min(unknown)}; there are: {', '.join(TARGETS)}")
    failed = False
    for name in options.targets or TARGETS:
        outcome = fuzz(name, options.count, options.seed)
        counted = ", ".join(f"{count:,} {what}" for what, count in outcome.counts.items())
        worst = f"at most {1e3 * outcome.worst_cpu_s:.1f} ms of CPU for one"
        print(f"{name}: {options.count:,} inputs, {counted}; {worst}; {len(outcome.faults)} faults", flush=True)
        for fault in outcome.faults[:SHOWN]:
            print(fault)
        failed = failed or bool(outcome.faults)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
