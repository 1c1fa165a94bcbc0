"""What a daemon waits for, and a simulator that is too late."""

import asyncio

import pytest

from formation.messages import Event, Severity
from wire.process.daemon import LATE_NS, Precondition, Punctuality, StarvedError, Stop, beside, report_missing


def test_says_what_is_missing_and_when_it_has_come(monkeypatch):
    there = {"bus": True, "autopilot": False}
    told: list[Event] = []
    slept: list[float] = []

    async def sleep(seconds: float) -> None:
        slept.append(seconds)
        there["autopilot"] = len(slept) > 3

    monkeypatch.setattr("wire.process.daemon.asyncio.sleep", sleep)
    awaited = [Precondition(name, lambda name=name: there[name], f"start the {name}") for name in there]

    async def others() -> str:
        return "lab 'hall': uav 2"

    asyncio.run(report_missing("uav2", awaited, told.append, others))
    there_text = "on the bus, but not of this lab: lab 'hall': uav 2. Is the lab's name right?"
    assert told == [
        Event(Severity.NOTICE, "uav2", "waiting for autopilot: start the autopilot"),
        Event(Severity.NOTICE, "uav2", there_text),
        Event(Severity.INFO, "uav2", "no longer waiting for autopilot"),
    ]


def test_on_time_and_a_little_late_is_well():
    punctual = Punctuality("the mocap emulator", "its exposure")
    for late_ns in (-5, 0, LATE_NS):
        punctual.check(10**9, 10**9 + late_ns)


def test_too_late_says_who_and_how_late():
    with pytest.raises(StarvedError, match=r"the mocap emulator is starved: its exposure 400 ms late"):
        Punctuality("the mocap emulator", "its exposure").check(10**9, 10**9 + 400_000_000)


def test_a_callback_that_raises_ends_a_process_and_a_forgotten_task_does_not() -> None:
    """A library's task that nobody awaits took the poses, or the guard, away with its process."""
    told: list[Event] = []

    async def fails() -> None:
        raise OSError("no disk")

    def raises() -> None:
        raise ZeroDivisionError("of ours")

    async def run() -> None:
        loop, stop = asyncio.get_running_loop(), Stop(told.append)
        loop.call_exception_handler({"message": "Task exception was never retrieved", "exception": OSError("lost")})
        async with beside(fails()):
            loop.call_later(1.5, raises)
            await stop.wait()

    with pytest.raises(ZeroDivisionError, match="of ours"):
        asyncio.run(run())
    assert [event.text for event in told] == [
        "failed: 1 x Task exception was never retrieved: OSError: lost",
        f"failed: 1 x {fails.__qualname__} has ended: OSError: no disk",
    ]
