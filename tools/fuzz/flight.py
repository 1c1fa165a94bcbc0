"""Anything that a bus or a port can bring, to cores in flight: ground, mocap, agent, bridge, page and live viewer.

    python -m tools.fuzz.flight --count 1000000

Each message goes to one target, by the functions that its daemon calls: MAVLink messages with every number extreme,
frames, requests, states and pieces of a log, some of them with bytes changed. Swarm and agent fly meanwhile. Whatever
is raised would have ended a process. Datagrams and frames of any bytes have fuzzers of their own beside this one.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from tools.fuzz.command import main
from tools.fuzz.messages import Draws
from tools.fuzz.targets import Targets


@dataclass(slots=True)
class Outcome:
    """How many messages each target was sent, and what was raised, in words."""

    sent: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)

    def text(self) -> str:
        """For people."""
        return ", ".join(f"{name} {count}" for name, count in self.sent.items()) + f": {len(self.faults)} exits"


def fuzz(count: int, seed: int, names: Sequence[str] = ()) -> Outcome:
    """That many messages to each target, or to those named; `faults` is empty where all was well."""
    outcome, draws = Outcome(), Draws(seed)
    for name in names or ("ground", "mocap", "agent", "bridge", "page", "live"):
        targets = Targets(draws)
        for k in range(count):
            outcome.sent[name] += 1
            try:
                targets.by_name[name]()
            except Exception as error:  # noqa: BLE001 - whatever it is, is what is looked for
                outcome.faults.append(f"{name}, message {k} of seed {seed}: {type(error).__name__}: {error}")
                targets = Targets(draws)
    return outcome


if __name__ == "__main__":
    main(fuzz, __doc__)
