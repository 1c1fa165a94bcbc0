"""What the operator is told of the bodies a server names."""

from formation.messages import Severity
from mocap.sources.body_list import BodyList
from tests.mocap.sources.recorded_feed import kept


def test_a_body_that_is_missing_is_named_and_what_is_there_with_it():
    record = kept("vicon", names={"Drone 2": "right"})
    body_list = BodyList(("lead", "right"), record.feed())
    assert body_list.receive(("wand", "Drone 2")) == ("wand", "right")
    assert [(e.severity, e.text) for e in record.events] == [
        (Severity.WARNING, "the server does not name lead; it names wand, right")
    ]


def test_only_changes_are_reported():
    record = kept("vicon")
    body_list = BodyList(("lead",), record.feed())
    body_list.receive(("lead",))
    body_list.receive(("lead",))
    body_list.receive(())
    assert record.texts() == ["the server names lead", "the server does not name lead; it names nothing"]
