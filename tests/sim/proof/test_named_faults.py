"""The faults that were found in flights before they were contained, by name: what one does is seen in the truth."""

from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from math import pi
from multiprocessing import get_context
from typing import NamedTuple

import pytest

from formation.messages import Verb
from sim.faults.fault import Family, Fault, OnsetPhase
from sim.proof.flight import fly
from sim.proof.group import fly_group
from sim.proof.labs import FORMATION_S, scenario
from sim.proof.oracle import Verdict
from sim.scenario import Scenario
from wire.process.system import safe_path_for_pools

SEED, SHARED = 1, 8
"""Every row's seed; and how many share a flight up to their onsets, so that all cores fly."""
Names = tuple[str, ...]


class Row(NamedTuple):
    """One fault of the table; benign: it must be flown through as planned."""

    name: str
    scenario: Scenario
    benign: bool = False


def _row(name: str, *faults: Fault, flight: Scenario | None = None, benign: bool = False) -> Row:
    return Row(name, (flight or scenario()).model_copy(update={"name": name, "faults": faults}), benign)


def _mocap(family: Family, body: str | None, for_s: float, severity: float = 1.0, **more: object) -> Fault:
    return Fault.model_validate(
        {"family": family, "after_s": 2.5, "body": body, "for_s": for_s, "severity": severity} | more
    )


def _link(family: Family, severity: float, for_s: float | None = None, **more: object) -> Fault:
    return Fault.model_validate({"family": family, "after_s": 2.5, "severity": severity, "for_s": for_s} | more)


def _asked(verb: Verb, after_s: float, phase: OnsetPhase = "FORMATION") -> Fault:
    return Fault(family=Family.REQUEST, phase=phase, after_s=after_s, verb=verb)


def _ground(family: Family, for_s: float | None = None, verb: Verb | None = None) -> Fault:
    return Fault(family=family, core="ground", after_s=2.5, for_s=for_s, verb=verb)


HOLD, ARDUCOPTER = scenario("hold"), scenario(autopilot="ardupilot")
WHOLE_S = FORMATION_S + 6.0
ROWS = {
    row.name: row
    for row in (
    _row("freeze", _mocap(Family.FREEZE, "f2", 0.5)),
    _row("freeze-take-off", _mocap(Family.FREEZE, "f2", 2.0, phase="TAKEOFF", after_s=0.4)),
    _row("one-frame-1e9", _mocap(Family.ABSURD, "f2", 0.009, 1e9)),
    _row("upside-down", _mocap(Family.FLIP, "f2", 0.4, 3.14159)),
    _row("leader-yaw", _mocap(Family.YAW, "leader", 0.2, 3.0)),
    _row(
        "leader-noise-joining", _mocap(Family.NOISE, "leader", 2.3, 0.004, phase="HOLD", after_s=0.1),
        flight=scenario("observed", 5),
    ),
    _row("swap-followers", _mocap(Family.SWAP, "f2", 0.6, other="f3")),
    _row("jump", _mocap(Family.JUMP, "f2", 0.6, 1.0, heading_rad=-1.57)),
    _row("twin-ground-arms", _ground(Family.TWIN, verb=Verb.ARM), flight=HOLD),
    _row("restarted-ground-arms", _ground(Family.RESTART, 1.0, Verb.ARM), flight=scenario("hold", 2, "ardupilot")),
    _row(
        "land-with-a-pilot", Fault(family=Family.PILOT, body="f2", after_s=2.5, for_s=6.0), _asked(Verb.LAND, 2.6)
    ),
    _row("ground-killed", _ground(Family.KILL)),
    _row("ardupilot-ground-killed", _ground(Family.KILL), flight=ARDUCOPTER),
    _row("ardupilot-ground-lands", _ground(Family.RESTART, 1.0, Verb.LAND), flight=ARDUCOPTER),
    _row("late-0.3", _link(Family.DELAY, 0.3, direction="down")),
    _row("leader-without-power", Fault(family=Family.WEAK_MOTORS, body="leader", after_s=2.5, severity=0.0)),
    _row("motors-at-0.6", Fault(family=Family.WEAK_MOTORS, body="f2", after_s=2.5, severity=0.6)),
    _row("growing-latency", _link(Family.GROWING_DELAY, 0.3, WHOLE_S, direction="down")),
    _row("loss-0.9", _link(Family.DROP, 0.9, direction="down")),
    _row("stop-at-0.2-loss", _link(Family.DROP, 0.2), _asked(Verb.STOP, 2.8)),
    _row(
        "nuisance",
        _link(Family.DROP, 0.05, phase="GROUND", after_s=1.0),
        _link(Family.JITTER, 0.02, phase="GROUND", after_s=1.0),
        flight=scenario().model_copy(update={"formation_s": 20.0}),
        benign=True,
    ),
    _row("hidden-latency", _mocap(Family.HIDDEN_LATENCY, None, WHOLE_S, 0.2)),
    _row(
        "hidden-latency-landing",
        Fault(family=Family.HIDDEN_LATENCY, phase="LAND", after_s=2.0, for_s=3.0, severity=0.33),
    ),
    _row("stamps-ahead", _mocap(Family.STAMP_OFFSET, None, WHOLE_S, 0.2)),
    _row("dead-motor", Fault(family=Family.DEAD_MOTOR, body="f2", after_s=2.5, severity=0.0)),
    _row("drift-0.4", _mocap(Family.DRIFT, "f2", WHOLE_S, 0.4, heading_rad=-pi / 2)),
    _row("frames-at-6-hz", Fault(family=Family.SLOW_STREAM, after_s=2.5, severity=0.94)),
    _row("ground-stalled", Fault(family=Family.STALL, core="ground", after_s=1.0, for_s=0.3), flight=HOLD),
    _row("guard-stalled", Fault(family=Family.STALL, core="agent", body="f2", after_s=1.0, for_s=0.39), flight=HOLD),
    _row("mocap-killed", Fault(family=Family.KILL, core="mocap", after_s=1.0), flight=HOLD),
    _row("landing-asked-for", _asked(Verb.LAND, 0.5), flight=HOLD),
    _row("twin-ground-stops", Fault(family=Family.TWIN, core="ground", verb=Verb.STOP, after_s=0.5), flight=HOLD),
    _row("noise", Fault(family=Family.NOISE, body="f2", severity=0.01, after_s=1.0, for_s=0.25), flight=HOLD),
    _row("log-full", Fault(family=Family.LOG_TROUBLE, after_s=2.5)),
    _row("no-fault", benign=True),
    )
}  # fmt: skip


def together() -> list[Names]:
    """The rows, those together whose flights are the same up to their faults, SHARED at most."""
    same: dict[str, list[str]] = {}
    for row in ROWS.values():
        same.setdefault((row.name if row.benign else "") + unharmed(row).model_dump_json(), []).append(row.name)
    return [tuple(names[i : i + SHARED]) for names in same.values() for i in range(0, len(names), SHARED)]


def unharmed(row: Row) -> Scenario:
    return row.scenario.model_copy(update={"name": "table", "faults": (), "seed": SEED})


def fly_rows(names: Names) -> dict[str, Verdict]:
    """Rows that share a flight, forked at their onsets."""
    first = ROWS[names[0]]
    if len(names) == 1:
        return {names[0]: fly(first.scenario, SEED, benign=first.benign).verdict}
    flown = fly_group(unharmed(first), {i: ROWS[name].scenario.faults for i, name in enumerate(names)})
    return {name: run.verdict for name, run in zip(names, flown.runs, strict=True)}


@pytest.fixture(scope="module")
def flights() -> Iterator[dict[str, Future[dict[str, Verdict]]]]:
    """Of every row the flight that it shares, in processes that can fork."""
    with safe_path_for_pools(), ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        shared = {names: pool.submit(fly_rows, names) for names in together()}
        yield {name: flight for names, flight in shared.items() for name in names}


@pytest.mark.parametrize("name", ROWS)
def test_a_named_fault_is_contained(name: str, flights: dict[str, Future[dict[str, Verdict]]]) -> None:
    verdict = flights[name].result()[name]
    assert verdict.contained, verdict.violations


def test_a_row_that_was_forked_ended_as_one_that_is_flown_whole(
    flights: dict[str, Future[dict[str, Verdict]]],
) -> None:
    assert fly(ROWS["guard-stalled"].scenario, SEED).verdict == flights["guard-stalled"].result()["guard-stalled"]


def test_what_is_known_of_a_fault_beyond_that_it_is_contained(flights: dict[str, Future[dict[str, Verdict]]]) -> None:
    verdicts = {name: flight.result()[name] for name, flight in flights.items()}
    stalled = verdicts["ground-stalled"]
    assert stalled.cause.endswith("Setpoints are stale: level and hold")
    assert stalled.detection_s == pytest.approx(0.1, abs=0.03)
    assert verdicts["mocap-killed"].detection_s is not None
    assert verdicts["noise"].drift_m < 0.6
    assert verdicts["dead-motor"].drift_m > 0.05  # it falls
