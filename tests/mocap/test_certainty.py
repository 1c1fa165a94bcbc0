"""How well exposures are known is told when it is news, and no more often."""

from formation.messages import Severity
from mocap.daemon import Certainty
from mocap.sources.source import SourceStatus

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
