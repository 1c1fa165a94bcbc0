"""What a campaign draws, how it flies and counts it, and that it fails where a monitor is switched off."""

import pytest

from sim.faults.fault import Family, Fault
from sim.monitors import NAMES, Without
from sim.proof import controls
from sim.proof.campaign import summarise
from sim.proof.draw import FAMILIES_DRAWN, GROUP, RANGES, Draw, faults_of, flight_of, run_of
from sim.proof.group import JobResult, Run
from sim.proof.oracle import Margin, Verdict, Violation
from sim.scenario import Scenario


def test_a_run_is_decided_by_seed_and_number_and_is_a_scenario_that_can_be_written() -> None:
    for number in range(60):
        run = run_of(Draw(7), number)
        assert run == run_of(Draw(7), number)
        assert 1 <= len(run.faults) <= 2
        assert Scenario.model_validate(run.model_dump()) == run
    assert run_of(Draw(7), 3).faults != run_of(Draw(8), 3).faults


def test_every_family_is_drawn_and_every_kind_of_flight() -> None:
    met = set(Family) - {Family.ROGUE_SETPOINT}  # a ground that is wrong within the bounds is nobody's to contain
    assert set(FAMILIES_DRAWN) == set(RANGES) == met
    flights = [flight_of(Draw(1), group) for group in range(80)]
    numbers = [(i * GROUP + n, flight) for i, flight in enumerate(flights) for n in range(GROUP)]
    drawn = {fault.family for number, flight in numbers for fault in faults_of(Draw(1), number, flight)}
    assert drawn == met
    vehicles = [vehicle for flight in flights for vehicle in flight.vehicles]
    assert {vehicle.autopilot for vehicle in vehicles} == {"px4", "ardupilot"}
    assert {len(flight.lab.followers) for flight in flights} >= {2, 3, 4, 5, 6, 8, 10}
    assert any(flight.lab.leader.sysid is None for flight in flights)


def test_chosen_families_are_those_of_every_first_fault_and_the_second_is_any() -> None:
    draw = Draw(7, (Family.DRIFT, Family.TWIN))
    runs = [run_of(draw, number).faults for number in range(300)]
    assert {faults[0].family for faults in runs} == {Family.DRIFT, Family.TWIN}
    assert len({faults[1].family for faults in runs if len(faults) > 1}) > 25


def test_a_summary_counts_what_failed_and_says_how_to_fly_it_again() -> None:
    bad = Verdict((Violation("fence", 3.0, "f2 0.70 m outside"), Violation("separation", 4.0, "near")), 2.0, 0.1, 1.0)
    good = Verdict((), 2.0, None, 0.0)
    kill = (Fault(family=Family.KILL, core="ground"),)
    result = summarise(Draw(5), [JobResult((Run(0, kill, good, 10.0), Run(1, kill, bad, 20.0)), 15.0, 2.0)])
    assert (result.runs, len(result.failures)) == (2, 1)
    assert (result.separation_violations, result.fence_violations) == (1, 1)
    assert result.failures[0].again == "gcs-sim campaign --replay 5:1"
    assert '"virtual_s_per_s_per_core": 15.0' in result.to_json({})
    assert '"seed": "5:1"' in result.to_json({})
    chosen = summarise(Draw(5, (Family.TWIN,), "px4_quad"), [JobResult((Run(1, kill, bad, 20.0),), 15.0, 2.0)])
    assert chosen.failures[0].again == "gcs-sim campaign --replay 5:1 --family twin --profile px4_quad"


def test_a_summary_names_the_runs_that_came_nearest_to_a_limit() -> None:
    kill = (Fault(family=Family.KILL, core="ground"),)
    used = (0.2, 0.9, 1.2, 0.5)
    runs = tuple(
        Run(number, kill, Verdict(() if one < 1.0 else (Violation("fence", 3.0, "far"),), 2.0, None, 0.0, "", (
            Margin("separation", 1.0, 0.1, "apart"), Margin("fence", 3.0, one, "outside"))), 10.0)
        for number, one in enumerate(used)
    )  # fmt: skip
    nearest = summarise(Draw(5), [JobResult(runs, 15.0, 2.0)]).nearest
    assert [(near.number, near.margin.kind) for near in nearest] == [(1, "fence"), (3, "fence"), (0, "fence")]


def test_monitors_go_to_the_cores_that_have_them_and_others_are_refused() -> None:
    without = Without(frozenset({"validator-jump", "stream-stale", "arm-in-air"}))
    assert (without.mocap, without.agent, without.ground) == ({"validator-jump"}, {"stream-stale"}, {"arm-in-air"})
    with pytest.raises(ValueError, match="no monitor 'nothing'"):
        Without(frozenset({"nothing"}))


def test_every_monitor_has_a_control_or_is_said_to_have_others_behind_it() -> None:
    assert set(controls.CONTROLS) | set(controls.REDUNDANT) == set(NAMES)
    assert not set(controls.CONTROLS) & set(controls.REDUNDANT)


NIGHTLY = [pytest.param(name, marks=pytest.mark.nightly) for name in ("own-land", "separation-filter")]


@pytest.mark.parametrize("monitor", [*NIGHTLY, "setpoint-bounds"])
def test_without_its_monitor_a_fault_does_harm_and_with_it_none(monitor: str) -> None:
    assert controls.fly_control(controls.ControlJob(monitor, 1)) == controls.ControlResult(without=True, with_it=False)


def test_a_control_shows_its_monitor_where_all_fail_without_it_and_none_with_it() -> None:
    job, failed, held = (
        controls.ControlJob("x", 1),
        controls.ControlResult(True, False),
        controls.ControlResult(False, False),
    )
    assert controls.shares([job] * 20, [failed] * 19 + [held])["x"].shows
    assert not controls.shares([job] * 20, [failed] * 18 + [held] * 2)["x"].shows
    assert not controls.shares([job] * 20, [failed] * 19 + [controls.ControlResult(True, True)])["x"].shows
