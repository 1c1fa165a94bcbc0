"""The mocap daemon in this process.
How well exposures are known is told when it is news, and no more often."""

import asyncio

import pytest

from formation.messages import Event, Severity
from mocap.daemon import Certainty, Outputs, run
from mocap.service import ServiceError, configuration_name
from mocap.sources.source import SourceStatus
from tests.gcs.bus import a_lab, hub_of
from tests.wire.waiting import in_loop
from wire.clock import REAL_TIME
from wire.transport.mocap_bus import MocapBus


@in_loop
async def test_one_that_was_left_behind_ends_when_no_ground_is_heard(monkeypatch):
    """Its ground was killed: it serves the drones that listen for a while, and the ground that comes next."""
    parents = iter([7])
    monkeypatch.setattr("mocap.daemon.os.getppid", lambda: next(parents, 1))
    config, events = a_lab(), list[Event]()
    bus = await hub_of(config)
    MocapBus(bus).on_frame(lambda _frame: None)
    left = asyncio.create_task(run(config, 1.0, Outputs(events.append), REAL_TIME))
    for _ in range(150):
        bus.publish_state("main", "a state of another version")
        await asyncio.sleep(0.02)
    assert not left.done()
    await asyncio.wait_for(left, 60.0)
    await bus.close()


@in_loop
async def test_a_second_mocap_process_is_rejected():
    config = a_lab()
    bus = await hub_of(config)
    MocapBus(bus).announce(configuration_name(config))
    with pytest.raises(ServiceError, match=f"serves '{config.name}' already"):
        await asyncio.wait_for(run(config, None, Outputs(lambda _: None), REAL_TIME), 60.0)
    await bus.close()


S = 1_000_000_000


def status(uncertainty_s: float | None, latency_measured: bool = True) -> SourceStatus:
    return SourceStatus("cameras", True, 0, 0.0042, uncertainty_s, latency_measured)


def test_it_is_reported_once_known_and_again_when_it_doubles_or_halves() -> None:
    certainty = Certainty()
    assert certainty.events(status(None), 0) == ()
    (first,) = certainty.events(status(0.0003), S)
    assert first.severity is Severity.INFO
    assert first.text == "capture times are certain to 0.30 ms; latency 4.2 ms"
    assert certainty.events(status(0.0004), 60 * S) == ()
    assert certainty.events(status(0.003), 5 * S) == ()
    (worse,) = certainty.events(status(0.003), 61 * S)
    assert worse.severity is Severity.WARNING
    (better,) = certainty.events(status(0.0002), 80 * S)
    assert better.severity is Severity.INFO


def test_a_constant_latency_that_is_not_measured_is_named() -> None:
    (event,) = Certainty().events(status(0.0003, latency_measured=False), S)
    assert "apart from the constant that latency_s says" in event.text
