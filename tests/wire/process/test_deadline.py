"""A call that does not return in time is ended; a machine that is busy with others is not taken for one."""

import asyncio
import signal
import threading
import time

import pytest
import uvloop

from formation.own_law.law import LawOverrunError
from wire.process.deadline import Deadline


def loop() -> None:
    while True:
        try:
            time.monotonic()
        except Exception:  # noqa: BLE001 - what a law of a lab's may do
            continue


def test_a_call_that_computes_on_and_on_is_ended() -> None:
    with pytest.raises(LawOverrunError, match="no answer within 10 ms"):
        Deadline(0.01, 10.0)(0, loop)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_a_call_that_sleeps_is_ended_by_the_wall_clock_and_by_that_alone() -> None:
    assert Deadline(0.005, 60.0)(0, lambda: time.sleep(0.05)) is None
    with pytest.raises(LawOverrunError, match="no answer within 50 ms"):
        Deadline(0.01, 0.05)(0, lambda: time.sleep(60.0))


def test_what_it_returns_and_raises_comes_through() -> None:
    assert Deadline(1.0, 1.0)(0, lambda: 7) == 7
    with pytest.raises(ZeroDivisionError):
        Deadline(1.0, 1.0)(0, lambda: 1 // 0)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_it_holds_inside_the_event_loop_of_the_daemons() -> None:
    async def twice() -> int:
        for _ in range(2):
            with pytest.raises(LawOverrunError):
                Deadline(0.01, 10.0)(0, loop)
            await asyncio.sleep(0.03)
        return 7

    assert uvloop.run(twice()) == 7


def test_another_thread_is_not_limited() -> None:
    said: list[int] = []
    thread = threading.Thread(target=lambda: said.append(Deadline(0.001, 0.001)(0, lambda: 7)))
    thread.start()
    thread.join()
    assert said == [7]


def test_the_second_call_that_is_slower_than_usual_is_the_last() -> None:
    """By the clock that is handed in: 1, 3, 1 and 3 ms of computing, 2 ms are usual."""
    readings_s = iter((0.0, 0.001, 0.0, 0.003, 0.0, 0.001, 0.0, 0.003))
    deadline = Deadline(10.0, 10.0, 0.002, lambda: next(readings_s))
    assert [deadline(0, lambda: 7) for _ in range(3)] == [7, 7, 7]
    with pytest.raises(LawOverrunError, match=r"more than 2 ms twice, now 3\.0 ms"):
        deadline(0, lambda: 7)
