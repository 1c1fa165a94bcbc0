"""What the operator is told of the bodies a server names."""

from recorded_feed import kept

from formation.messages import Severity
from gcs.mocap.sources.roll_call import RollCall


def test_a_body_that_is_missing_is_named_and_what_is_there_with_it():
    record = kept("vicon", names={"Drone 2": "right"})
    roll = RollCall(("lead", "right"), record.feed())
    assert roll.take(("wand", "Drone 2")) == ("wand", "right")
    assert [(e.severity, e.text) for e in record.said] == [
        (Severity.WARNING, "the server does not name lead; it names wand, right")
    ]


def test_only_changes_are_told():
    record = kept("vicon")
    roll = RollCall(("lead",), record.feed())
    roll.take(("lead",))
    roll.take(("lead",))
    roll.take(())
    assert record.texts() == ["the server names lead", "the server does not name lead; it names nothing"]
