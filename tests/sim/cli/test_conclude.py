"""What the host saw and what the log tells, in one outcome."""

from functools import partial

import pytest

from analysis.load import from_records
from formation import topics
from formation.codes import FlightResult, Outcome
from formation.messages import Datagram, LabFrame
from sim.cli.conclude import _joined, _starved
from tests.analysis.synthetic_flight import METADATA, T0_NS, Recipe, Record, records
from wire.link_messages import Address, NamedValue
from wire.mavlink.codec import Codec

LANDED = Outcome(FlightResult.LANDED)
lost, aborted, starved = (
    partial(Outcome, result) for result in (FlightResult.LOST, FlightResult.ABORTED, FlightResult.STARVED)
)


@pytest.mark.parametrize(
    ("host", "log", "told"),
    [
        (LANDED, LANDED, LANDED),
        (LANDED, lost("F fell"), lost("F fell")),
        (aborted("agent-3 ended"), LANDED, aborted("agent-3 ended")),
        (aborted("agent-3 ended"), lost("F unheard"), lost("agent-3 ended; F unheard")),
        (aborted("back on the ground"), aborted("mocap lost"), aborted("mocap lost")),
        (starved("too slow"), LANDED, starved("too slow")),
    ],
)
def test_the_worse_of_both_is_told_with_both_reasons(host: Outcome, log: Outcome, told: Outcome) -> None:
    assert _joined(host, log) == told


@pytest.mark.parametrize(("age_ms", "is_starved"), [(400.0, True), (60.0, False)])
def test_a_drone_that_had_old_setpoints_before_the_end_was_late(age_ms: float, is_starved: bool) -> None:
    """Its process shows its pose too seldom for the cameras then, which looks like a body that is not seen."""
    codec, ages = Codec(Address(2, 1)), {10.0: 12.0, 12.0: 12.0, 15.5: age_ms}
    said = [
        Record(topics.LINK_UP, T0_NS + round(t_s * 1e9), Datagram(2, codec.encode(NamedValue(0, "age_ms", age))))
        for t_s, age in ages.items()
    ]
    flight = from_records(METADATA, sorted([*records(Recipe()), *said], key=lambda record: record.t_ns))
    assert (_starved(aborted("body not seen for 0.4 s"), flight, 1.0).result is FlightResult.STARVED) == is_starved


@pytest.mark.parametrize(
    ("late_s", "outcome", "told"),
    [
        (0.4, aborted("body not seen for 0.4 s"), starved("poses, control cycles or setpoints were 400 ms late, "
         "the machine is too slow (body not seen for 0.4 s); fly with --speed 0.12")),
        (0.4, LANDED, LANDED),
        (0.4, lost("F fell"), lost("F fell")),
        (0.05, aborted("body not seen for 0.4 s"), aborted("body not seen for 0.4 s")),
        (0.05, starved("too slow"), starved("too slow; fly with --speed 0.35")),
    ],
)  # fmt: skip
def test_a_machine_that_was_late_before_the_end_is_the_cause(late_s: float, outcome: Outcome, told: Outcome) -> None:
    """The landing begins at 16 s; the frames of the half second before it came late."""

    def came(record: Record) -> Record:
        is_late = isinstance(record.message, LabFrame) and 15.0 < (record.t_ns - T0_NS) * 1e-9 < 15.5
        return Record(record.topic, record.t_ns + round(late_s * 1e9), record.message) if is_late else record

    flight = from_records(METADATA, sorted(map(came, records(Recipe())), key=lambda record: record.t_ns))
    assert _starved(outcome, flight, 1.0) == told
