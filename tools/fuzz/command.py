"""The command line that every fuzzer has: so many draws of a seed, how it went, and exit code 1 for any fault."""

import argparse
import sys
from collections.abc import Callable
from typing import Protocol


class Result(Protocol):
    """What a fuzzer found."""

    faults: list[str]

    def text(self) -> str:
        """For people."""


def main(run: Callable[[int, int], Result], doc: str | None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(description=(doc or "").split("\n", 1)[0])
    parser.add_argument("--count", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    result = run(options.count, options.seed)
    print(result.text())
    for fault in result.faults[:20]:
        print(fault)
    sys.exit(1 if result.faults else 0)
