"""What the guard's navigator detects in every row of the fault campaign, flown.

python -m tools.guard_detections              # all rows, as a Markdown table
python -m tools.guard_detections drift jump   # these
python -m tools.guard_detections --nominal 3  # false detections in 3 flights of each shipped scenario, or named ones
"""

import argparse
from collections.abc import Sequence
from typing import NamedTuple

from formation.messages import Event
from formation.topics import EVENT, Topic
from sim.campaign.flight import Flight
from sim.campaign.table import SEED, Row, table
from sim.lockstep import fly, uncollected
from sim.scenario import load
from sim.shipped import shipped


class Detected(NamedTuple):
    """One flight: detections as (drone, s after the fault's onset, name), if the fault was contained, and the drift."""

    detections: list[tuple[int, float, str]]
    contained: bool
    drift_m: float


def detected(row: Row) -> Detected:
    """Fly a row."""
    flight = Flight(row.scenario, SEED)
    found: list[tuple[int, int, str]] = []
    rejecting: dict[int, bool] = {}
    with uncollected():
        over = False
        while not over:
            over = flight.advance()
            for sysid, node in flight.world.nodes.items():
                found += [(sysid, flight.world.now_ns, fault.signature.name) for fault in node.faults]
                node.faults.clear()
                rejects = any(guard.rejects_poses for guard in node.drone.guards)
                if rejects and not rejecting.get(sysid):
                    found.append((sysid, flight.world.now_ns, "guard holds"))
                rejecting[sysid] = rejects
    onset_ns = flight.world.faults.first_ns or flight.world.now_ns
    times = [(sysid, (t_ns - onset_ns) * 1e-9, name) for sysid, t_ns, name in found]
    verdict = flight.verdict(benign=row.benign)
    return Detected(times, verdict.contained, verdict.drift_m)


def line(name: str, result: Detected) -> str:
    """One row of the Markdown table; detections before the onset are false."""
    first: dict[tuple[int, str], float] = {}
    false = 0
    for sysid, after_s, what in result.detections:
        if after_s < 0.0:
            false += what != "guard holds"
        else:
            first.setdefault((sysid, what), after_s)
    cells = [f"{sysid}: {what} {after_s:.2f} s" for (sysid, what), after_s in first.items()]
    contained = "yes" if result.contained else "no"
    return f"| {name} | {'; '.join(cells) or '-'} | {false} | {contained} | {result.drift_m:.2f} |"


def nominal(name: str, seed: int) -> tuple[float, list[str]]:
    """Seconds of drones in a shipped scenario and what the guard reported in it."""
    scenario = load(name)
    found: list[str] = []

    def record(topic: Topic, message: object, _t_ns: int) -> None:
        if topic is EVENT and isinstance(message, Event) and message.text.startswith(("Pose rejected", "Part of its")):
            found.append(f"{message.source}: {message.text}")

    flown = fly(scenario, seed, record)
    return flown.duration_s * len([v for v in scenario.lab.vehicles if v.sysid is not None]), found


def report_nominal(count: int, names: Sequence[str]) -> None:
    """Fly shipped scenarios, print what was detected falsely."""
    total_s = 0.0
    for name in names or shipped():
        if load(name).needs_leader_file:
            continue
        for seed in range(1, count + 1):
            seconds, found = nominal(name, seed)
            total_s += seconds
            print(f"{name} {seed}: {seconds:.0f} s of drones: {'; '.join(found) or '-'}", flush=True)
    print(f"{total_s / 3600.0:.2f} h of drones")


def main() -> None:
    """Print the table, or what was detected falsely."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("names", nargs="*", help="rows of the campaign's table, or with --nominal scenarios; else all")
    parser.add_argument("--nominal", type=int, metavar="N", help="fly scenarios without a fault, N times each")
    asked = parser.parse_args()
    if asked.nominal is not None:
        report_nominal(asked.nominal, asked.names)
        return
    wanted = set(asked.names)
    print("| row | first detections after the onset, by drone | false before it | contained | drift, m |")
    print("|---|---|---|---|---|")
    for row in table():
        if not wanted or row.name in wanted:
            print(line(row.name, detected(row)), flush=True)


if __name__ == "__main__":
    main()
