"""The campaign's table, flown: what a fault does is seen in the truth, whatever is made of it."""

from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from multiprocessing import get_context

import pytest

from sim.campaign.flight import fly
from sim.campaign.oracle import Verdict
from sim.campaign.table import SEED, fly_rows, shared_flights, table
from wire.process.python import safe_path_for_pools

NAMES = [row.name for row in table()]


Flights = dict[str, Future[dict[str, Verdict]]]


@pytest.fixture(scope="module")
def flights() -> Iterator[Flights]:
    """Of every row, the flight that it shares, in processes that can fork."""
    with safe_path_for_pools(), ProcessPoolExecutor(2, mp_context=get_context("spawn")) as pool:
        shared = {names: pool.submit(fly_rows, names) for names in shared_flights(NAMES)}
        yield {name: flight for names, flight in shared.items() for name in names}


def test_the_names_of_the_table_are_unique() -> None:
    assert len(set(NAMES)) == len(NAMES)


@pytest.mark.parametrize("name", NAMES)
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
    assert max(verdicts[name].drift_m for name in ("noise-0.005", "noise-0.01")) < 0.6
    assert verdicts["dead-motor"].drift_m > 0.05  # it falls
