"""Record five lockstep flights, or compare today's with a recording: a change of words must not change a bit.

    python -m tools.recorded_flights write flights.json     # with the version before the change
    python -m tools.recorded_flights compare flights.json   # with the version after it; exit code 1 where they differ

A recording holds digests of the attitude targets, of the datagrams to the drones, of the phases and of the true states,
one a simulated second. It is valid on the machine that made it: other processors round differently.
"""

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path

import numpy as np

from formation import topics
from formation.topics import Topic
from sim.campaign.flight import fly
from sim.campaign.labs import scenario as campaign_scenario
from sim.lockstep import run_in_memory
from sim.scenario import load
from wire.logs.mcap_read import Entry

SECOND_NS = 1_000_000_000
RECORDED: tuple[Topic, ...] = (topics.TARGET, topics.LINK_DOWN, topics.PHASE, topics.TRUTH)
ADDED = ("held_off",)
"""Fields that recordings made before them lack."""
FLIGHTS = ("line", "circle", "twenty", "campaign", "gust")


def main() -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("verb", choices=("write", "compare"))
    parser.add_argument("file", type=Path, help="the recording, a JSON file")
    parser.add_argument("--only", choices=FLIGHTS, action="append", help="this flight only; again for more")
    options = parser.parse_args()
    known = json.loads(options.file.read_text()) if options.verb == "compare" else {}
    found: dict[str, dict[str, list[str]]] = {}
    differences = 0
    for name in options.only or FLIGHTS:
        found[name] = digests(flight_entries(name))
        if options.verb == "write":
            print(f"{name}: recorded")
            continue
        text = first_difference(known[name], found[name])
        differences += text is not None
        print(f"{name}: {text or 'bit-identical'}", flush=True)
    if options.verb == "write":
        options.file.write_text(json.dumps(found))
    return 1 if differences else 0


def flight_entries(name: str) -> list[Entry]:
    """Fly one of the five; its log entries."""
    if name == "campaign":
        entries: list[Entry] = []
        fly(campaign_scenario(), 7, lambda topic, message, t_ns: entries.append(Entry(topic, t_ns, message)))
        return entries
    scenario_name = {"line": "triangle_line", "circle": "triangle_circle", "gust": "hover_gust"}.get(name, name)
    return run_in_memory(load(scenario_name), 7)[1]


def digests(entries: list[Entry]) -> dict[str, list[str]]:
    """One digest a simulated second of every recorded topic, by the topic's name."""
    found: dict[str, list[str]] = {}
    for topic in RECORDED:
        mine = [entry for entry in entries if entry.topic is topic]
        start_ns = entries[0].t_ns
        seconds: dict[int, hashlib._Hash] = {}
        for entry in mine:
            digest = seconds.setdefault((entry.t_ns - start_ns) // SECOND_NS, hashlib.sha256())
            for piece in pieces(entry.message):
                digest.update(piece)
        found[topic.name] = [f"{second}:{digest.hexdigest()[:16]}" for second, digest in sorted(seconds.items())]
    return found


def pieces(message: object) -> Iterator[bytes]:
    """The bytes of a message's numbers, in the order of its fields; its texts are left out."""
    for field in fields(message):  # type: ignore[arg-type]
        value = getattr(message, field.name)
        if field.name in ADDED:
            continue
        if isinstance(value, bytes):
            yield value
        elif not isinstance(value, str):
            yield np.asarray(value).tobytes()


def first_difference(known: dict[str, list[str]], found: dict[str, list[str]]) -> str | None:
    """Where two recordings of a flight differ first; None if nowhere."""
    differing = []
    for topic, seconds in known.items():
        if seconds != found[topic]:
            pairs = zip(seconds, found[topic], strict=False)
            at = next((a.split(":")[0] for a, b in pairs if a != b), "the end")
            differing.append(f"{topic} from second {at}")
    return ", ".join(differing) or None


if __name__ == "__main__":
    sys.exit(main())
