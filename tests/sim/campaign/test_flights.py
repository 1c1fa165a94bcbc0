"""The campaign's table, flown: what a fault does is seen in the truth, whatever is made of it."""

from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from sim.campaign.flight import fly
from sim.campaign.oracle import Verdict
from sim.campaign.table import SEED, fly_rows, shared_flights, table
from wire.process.system import safe_path_for_pools

NAMES = [row.name for row in table()]
NIGHTLY = {
    "freeze-leader", "one-frame-900-m", "swap-leader", "late-0.15", "late-0.8", "drift", "drift-0.15", "noise-0.005",
    "stamps-behind", "guard-stalled-0.384", "guard-stalled-0.394", "guard-stalled-0.398",
}  # fmt: skip
"""Rows of which another here differs in a number or a body alone."""
CONTAINED = "test_a_fault_of_the_table_is_contained["
Flights = dict[str, Future[dict[str, Verdict]]]


@pytest.fixture(scope="module")
def flights(request: pytest.FixtureRequest) -> Iterator[Flights]:
    """Of every row, nightly ones where they are asked for, the flight that it shares, in processes that can fork."""
    asked = {item.callspec.params["name"] for item in request.session.items if item.name.startswith(CONTAINED)}
    names = [name for name in NAMES if name not in NIGHTLY or name in asked]
    with safe_path_for_pools(), ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        shared = {together: pool.submit(fly_rows, together) for together in shared_flights(names)}
        yield {name: flight for together, flight in shared.items() for name in together}


def test_the_names_of_the_table_are_unique() -> None:
    assert len(set(NAMES)) == len(NAMES)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.nightly] * (name in NIGHTLY)) for name in NAMES]
)
def test_a_fault_of_the_table_is_contained(name: str, flights: Flights) -> None:
    verdict = flights[name].result()[name]
    assert verdict.contained, verdict.violations


def test_a_row_that_was_forked_ended_as_one_that_is_flown_whole(flights: Flights) -> None:
    row = next(row for row in table() if row.name == "guard-stalled-0.39")
    assert fly(row.scenario, SEED).verdict == flights[row.name].result()[row.name]


def test_what_is_known_of_a_fault_beyond_that_it_is_contained(flights: Flights) -> None:
    verdicts = {name: flight.result()[name] for name, flight in flights.items()}
    stalled = verdicts["ground-stalled"]
    assert stalled.cause.endswith("Setpoints are stale: level and hold")
    assert stalled.detection_s == pytest.approx(0.1, abs=0.03)
    assert verdicts["mocap-killed"].detection_s is not None
    assert verdicts["noise-0.01"].drift_m < 0.6
    assert verdicts["dead-motor"].drift_m > 0.05  # it falls
