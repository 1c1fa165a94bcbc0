"""The faults that were found in flights before they were contained, by name."""

from collections.abc import Sequence
from math import pi
from typing import NamedTuple

from formation.messages import Verb
from sim.campaign.flight import fly
from sim.campaign.group import fly_group
from sim.campaign.labs import FORMATION_S, scenario
from sim.campaign.oracle import Verdict
from sim.faults.fault import Family, Fault, OnsetPhase
from sim.scenario import Scenario

SEED, SHARED = 1, 8
"""Every row's seed; and how many share a flight up to their onsets, so that all cores fly."""


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


Names = tuple[str, ...]


def shared_flights(names: Sequence[str]) -> list[Names]:
    """These rows, those together whose flights are the same up to their faults: some at a time."""
    same: dict[str, list[str]] = {}
    for row in table():
        if row.name in names:
            alone = row.name if row.benign else ""
            same.setdefault(alone + _unharmed(row).model_dump_json(), []).append(row.name)
    return [tuple(rows[i : i + SHARED]) for rows in same.values() for i in range(0, len(rows), SHARED)]


def fly_rows(names: Names) -> dict[str, Verdict]:
    """Fly rows that share a flight, forked at their onsets, and judge them; KeyError where a name is no row's."""
    rows = {row.name: row for row in table()}
    first = rows[names[0]]
    if len(names) == 1:
        return {names[0]: fly(first.scenario, SEED, benign=first.benign).verdict}
    flown = fly_group(_unharmed(first), {i: rows[name].scenario.faults for i, name in enumerate(names)})
    return {name: run.verdict for name, run in zip(names, flown.runs, strict=True)}


def _unharmed(row: Row) -> Scenario:
    return row.scenario.model_copy(update={"name": "table", "faults": (), "seed": SEED})


def table() -> tuple[Row, ...]:
    """Every row."""
    arducopter, hold = scenario(autopilot="ardupilot"), scenario("hold")
    guard_stalled = Fault(family=Family.STALL, core="agent", body="f2", after_s=1.0, for_s=0.39)
    whole = FORMATION_S + 6.0
    return (
        _row("freeze", _mocap(Family.FREEZE, "f2", 0.5)),
        _row("freeze-leader", _mocap(Family.FREEZE, "leader", 0.5)),
        _row("freeze-take-off", _mocap(Family.FREEZE, "f2", 2.0, phase="TAKEOFF", after_s=0.4)),
        _row("one-frame-1e9", _mocap(Family.ABSURD, "f2", 0.009, 1e9)),
        _row("one-frame-900-m", _mocap(Family.ABSURD, "f2", 0.012, 900.0)),
        _row("upside-down", _mocap(Family.FLIP, "f2", 0.4, 3.14159)),
        _row("leader-yaw", _mocap(Family.YAW, "leader", 0.2, 3.0)),
        _row(
            "leader-noise-joining", _mocap(Family.NOISE, "leader", 2.3, 0.004, phase="HOLD", after_s=0.1),
            flight=scenario("observed", 5),
        ),
        _row("swap-followers", _mocap(Family.SWAP, "f2", 0.6, other="f3")),
        _row("swap-leader", _mocap(Family.SWAP, "leader", 0.6, other="f2")),
        _row("jump", _mocap(Family.JUMP, "f2", 0.6, 1.0, heading_rad=-1.57)),
        _row("twin-ground-arms", _ground(Family.TWIN, verb=Verb.ARM), flight=hold),
        _row("restarted-ground-arms", _ground(Family.RESTART, 1.0, Verb.ARM), flight=scenario("hold", 2, "ardupilot")),
        _row(
            "land-with-a-pilot", Fault(family=Family.PILOT, body="f2", after_s=2.5, for_s=6.0), _asked(Verb.LAND, 2.6)
        ),
        _row("ground-killed", _ground(Family.KILL)),
        _row("ardupilot-ground-killed", _ground(Family.KILL), flight=arducopter),
        _row("ardupilot-ground-lands", _ground(Family.RESTART, 1.0, Verb.LAND), flight=arducopter),
        _row("late-0.15", _link(Family.DELAY, 0.15, direction="down")),
        _row("late-0.3", _link(Family.DELAY, 0.3, direction="down")),
        _row("late-0.8", _link(Family.DELAY, 0.8, direction="down")),
        _row("leader-without-power", Fault(family=Family.WEAK_MOTORS, body="leader", after_s=2.5, severity=0.0)),
        _row("motors-at-0.6", Fault(family=Family.WEAK_MOTORS, body="f2", after_s=2.5, severity=0.6)),
        _row("growing-latency", _link(Family.GROWING_DELAY, 0.3, whole, direction="down")),
        _row("loss-0.9", _link(Family.DROP, 0.9, direction="down")),
        _row("stop-at-0.2-loss", _link(Family.DROP, 0.2), _asked(Verb.STOP, 2.8)),
        _row(
            "nuisance",
            _link(Family.DROP, 0.05, phase="GROUND", after_s=1.0),
            _link(Family.JITTER, 0.02, phase="GROUND", after_s=1.0),
            flight=scenario().model_copy(update={"formation_s": 20.0}),
            benign=True,
        ),
        _row("hidden-latency", _mocap(Family.HIDDEN_LATENCY, None, whole, 0.2)),
        _row(
            "hidden-latency-landing",
            Fault(family=Family.HIDDEN_LATENCY, phase="LAND", after_s=2.0, for_s=3.0, severity=0.33),
        ),
        _row("stamps-ahead", _mocap(Family.STAMP_OFFSET, None, whole, 0.2)),
        _row("stamps-behind", _mocap(Family.STAMP_OFFSET, None, whole, -0.2)),
        _row("dead-motor", Fault(family=Family.DEAD_MOTOR, body="f2", after_s=2.5, severity=0.0)),
        _row("drift", _mocap(Family.DRIFT, "f2", whole, 0.05)),
        _row("drift-0.15", _mocap(Family.DRIFT, "f2", whole, 0.15, heading_rad=-pi / 2)),
        _row("drift-0.4", _mocap(Family.DRIFT, "f2", whole, 0.4, heading_rad=-pi / 2)),
        _row("frames-at-6-hz", Fault(family=Family.SLOW_STREAM, after_s=2.5, severity=0.94)),
        _row("ground-stalled", Fault(family=Family.STALL, core="ground", after_s=1.0, for_s=0.3), flight=hold),
        *(
            _row(f"guard-stalled-{for_s}", guard_stalled.model_copy(update={"for_s": for_s}), flight=hold)
            for for_s in (0.384, 0.39, 0.394, 0.398)
        ),
        _row("mocap-killed", Fault(family=Family.KILL, core="mocap", after_s=1.0), flight=hold),
        _row("landing-asked-for", _asked(Verb.LAND, 0.5), flight=hold),
        _row("twin-ground-stops", Fault(family=Family.TWIN, core="ground", verb=Verb.STOP, after_s=0.5), flight=hold),
        *(
            _row(f"noise-{m}", Fault(family=Family.NOISE, body="f2", severity=m, after_s=1.0, for_s=0.25), flight=hold)
            for m in (0.005, 0.01)
        ),
        _row("log-full", Fault(family=Family.LOG_TROUBLE, after_s=2.5)),
        _row("no-fault", benign=True),
    )  # fmt: skip
