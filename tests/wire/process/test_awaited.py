"""What is missing is said once, with what to do, and again when it has come."""

import asyncio

from formation.messages import Event, Severity
from wire.process.awaited import Awaited, report_missing


def test_says_what_is_missing_and_when_it_has_come(monkeypatch):
    there = {"bus": True, "autopilot": False}
    told: list[Event] = []
    slept: list[float] = []

    async def sleep(seconds: float) -> None:
        slept.append(seconds)
        there["autopilot"] = len(slept) > 3

    monkeypatch.setattr("wire.process.awaited.asyncio.sleep", sleep)
    awaited = [Awaited(name, lambda name=name: there[name], f"start the {name}") for name in there]

    async def others() -> str:
        return "lab 'hall': uav 2"

    asyncio.run(report_missing("uav2", awaited, told.append, others))
    there_text = "on the bus, but not of this lab: lab 'hall': uav 2. Is the lab's name right?"
    assert told == [
        Event(Severity.NOTICE, "uav2", "waiting for autopilot: start the autopilot"),
        Event(Severity.NOTICE, "uav2", there_text),
        Event(Severity.INFO, "uav2", "no longer waiting for autopilot"),
    ]
