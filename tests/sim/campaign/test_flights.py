"""Whole flights with faults, each a few seconds: what a fault does is seen in the truth, whatever is made of it."""

import pytest

from formation.messages import Verb
from sim.campaign.flight import fly
from sim.campaign.labs import scenario
from sim.campaign.oracle import Verdict
from sim.campaign.table import fly_rows, shared_flights, table
from sim.faults.fault import Family, Fault
from sim.studies.runner import run_all


def flown(*faults: Fault) -> Verdict:
    return fly(scenario("hold").model_copy(update={"faults": faults}), 1).verdict


def test_the_names_of_the_table_are_unique() -> None:
    names = [row.name for row in table()]
    assert len(set(names)) == len(names)


@pytest.fixture(scope="module")
def verdicts() -> dict[str, Verdict]:
    """Of every row, flown beside these tests, in processes that can fork."""
    flights = run_all(fly_rows, shared_flights([row.name for row in table()]), lambda: None, workers=2)
    return {name: verdict for flight in flights for name, verdict in flight.items()}


@pytest.mark.parametrize("name", [row.name for row in table()])
def test_a_fault_of_the_table_is_contained(name: str, verdicts: dict[str, Verdict]) -> None:
    assert verdicts[name].contained, verdicts[name].violations


def test_a_ground_that_was_stalled_goes_on_where_it_was() -> None:
    verdict = flown(Fault(family=Family.STALL, core="ground", after_s=1.0, for_s=0.3))
    assert verdict.contained
    assert verdict.cause.endswith("Setpoints are stale: level and hold")
    assert verdict.detection_s == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize("for_s", [0.384, 0.39, 0.394, 0.398])
def test_what_waited_for_a_stalled_guard_is_as_old_as_it_was_sent(for_s: float) -> None:
    stall = Fault(family=Family.STALL, core="agent", body="f2", after_s=1.0, for_s=for_s)
    verdict = flown(stall)
    assert verdict.contained, verdict.violations


def test_a_mocap_that_is_gone_for_good_ends_on_the_floor() -> None:
    verdict = flown(Fault(family=Family.KILL, core="mocap", after_s=1.0))
    assert verdict.detection_s is not None
    assert "no-end" not in verdict.kinds


def test_a_request_is_made_when_it_is_due() -> None:
    verdict = flown(Fault(family=Family.REQUEST, verb=Verb.LAND, after_s=0.5))
    assert verdict.contained


def test_a_stop_that_a_second_ground_is_asked_for_is_the_operators() -> None:
    verdict = flown(Fault(family=Family.TWIN, core="ground", verb=Verb.STOP, after_s=0.5))
    assert verdict.contained, verdict.violations


@pytest.mark.parametrize("severity", [0.005, 0.01])
def test_a_pose_that_becomes_noisy_for_a_moment_throws_nobody_about(severity: float) -> None:
    verdict = flown(Fault(family=Family.NOISE, body="f2", severity=severity, after_s=1.0, for_s=0.25))
    assert verdict.contained, verdict.violations
    assert verdict.drift_m < 0.6


def test_a_drone_with_a_dead_motor_falls() -> None:
    verdict = flown(Fault(family=Family.DEAD_MOTOR, body="f2", motor=2, severity=0.0, after_s=0.5))
    assert verdict.drift_m > 0.05
