import pytest
from pydantic import ValidationError

from formation.messages import Phase
from sim.faults.fault import Family, Fault, Site
from sim.faults.onsets import Onsets
from sim.proof.labs import scenario
from sim.scenario import Scenario
from wire import config_file
from wire.transport.memory_bus import NOTHING_DUE_NS


def test_a_scenario_file_carries_its_faults() -> None:
    faults = (
        Fault(family=Family.FREEZE, body="f2", after_s=2.0, for_s=0.5),
        Fault(family=Family.STALL, core="ground", phase="TAKEOFF", for_s=0.3),
    )
    flight = scenario().model_copy(update={"faults": faults})
    text = config_file.dump(flight)
    assert 'family = "freeze"' in text
    assert Scenario.model_validate(flight.model_dump()).faults == faults


@pytest.mark.parametrize(
    ("values", "missing"),
    [
        ({"family": "kill"}, "core"),
        ({"family": "stall", "core": "ground"}, "for_s"),
        ({"family": "swap", "body": "f2"}, "other"),
        ({"family": "request"}, "verb"),
    ],
)
def test_a_fault_that_does_not_say_what_it_hits_is_refused(values: dict[str, object], missing: str) -> None:
    with pytest.raises(ValidationError, match=f"needs `{missing}`"):
        Fault.model_validate(values)


def test_a_fault_of_a_body_that_is_not_in_the_lab_is_refused() -> None:
    values = scenario().model_dump() | {"faults": [{"family": "freeze", "body": "nobody"}]}
    with pytest.raises(ValidationError, match="nobody, which the fault `freeze` is about, is not in the lab"):
        Scenario.model_validate(values)


def test_a_fault_begins_when_its_phase_is_first_entered_and_ends_after_its_length() -> None:
    fault = Fault(family=Family.FREEZE, phase="HOLD", after_s=1.0, for_s=0.5)
    onsets = Onsets([fault])
    onsets.enter(Phase.GROUND, 0)
    assert onsets.next_due_ns == NOTHING_DUE_NS
    onsets.enter(Phase.HOLD, 2_000_000_000)
    onsets.enter(Phase.HOLD, 9_000_000_000)
    assert onsets.pop_due(2_999_999_999) == []
    assert onsets.pop_due(3_000_000_000) == [(fault, True)]
    assert onsets.first_ns == 3_000_000_000
    assert onsets.active[Site.CAMERAS] == [(0, fault, 3_000_000_000)]
    assert list(onsets.active[Site.LINK]) == []
    assert onsets.pop_due(3_500_000_000) == [(fault, False)]
    assert list(onsets.active[Site.CAMERAS]) == []
