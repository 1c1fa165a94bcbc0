"""The ground's published state as JSON: it comes back as it was, with the keys that scripts read, or not at all."""

import json
from dataclasses import replace
from typing import Any

import pytest

from formation.messages import Phase, Severity
from tests.gcs.fakes import FakeLab, flying, triangle
from wire.ground_state import VERSION, Alarm, GroundState, PublishedEvent, StateError, decode, encode


@pytest.fixture(scope="module")
def state() -> GroundState:
    """In formation, with an event and an alarm."""
    events = (PublishedEvent(1, 5.0, Severity.NOTICE, "flight", "a"),)
    return replace(flying().state, events=events, alarms=(Alarm(6.0, Severity.ERROR, "safety", "b", goes_on=True),))


def test_comes_back_as_it_was(state: GroundState) -> None:
    assert decode(encode(state)) == state


def test_the_json_has_names_for_codes_and_null_for_what_is_unknown(state: GroundState) -> None:
    values = json.loads(encode(state))
    assert (values["version"], values["phase"], values["events"][0]["severity"]) == (VERSION, "FORMATION", "NOTICE")
    assert values["drones"][0]["body"] == "lead"
    assert values["drones"][0]["battery"] is None
    assert values["refusals"] == values["prearm_failures"]  # its name before 0.3
    assert set(values["allowed"]) >= {"arm", "land", "stop", "trajectory"}


def test_another_version_is_rejected_with_both_and_what_to_do(state: GroundState) -> None:
    values = json.loads(encode(state)) | {"version": VERSION + 1}
    with pytest.raises(StateError, match=f"version {VERSION + 1}, this program reads version {VERSION}: install"):
        decode(json.dumps(values))
    del values["version"]  # a ground of a release before states had one
    with pytest.raises(StateError, match=f"version 0, this program reads version {VERSION}"):
        decode(json.dumps(values))


@pytest.mark.parametrize(
    ("key", "value"),
    [("phase", "HOVER"), ("phase", 30), ("drones", [3]), ("drones", 3), ("drones", [{}]), ("t_s", "one"), ("armed", 7),
     ("allowed", {"arm": "no"}), ("allowed", {"arm": [1]}), ("slots_lead_m", [[1.0, 2.0]]), ("trajectory_s", [None, 1]),
     ("counters", None), ("ground_session", 1.5), ("not_landed", 1)],
)  # fmt: skip
def test_a_value_of_another_kind_is_rejected(state: GroundState, key: str, value: Any) -> None:
    with pytest.raises(StateError, match=f"no state of a ground, though of version 1: {key}"):
        decode(json.dumps(json.loads(encode(state)) | {key: value}))


def test_motors_are_known_of_drones_that_were_heard_alone() -> None:
    lab = FakeLab(triangle())
    lab.drones[3].sends_nothing = True
    lab.run(2.0)
    lab.drones[2].armed = True
    lab.run(1.0)
    assert lab.phase is Phase.GROUND
    assert lab.state.motors_on == {"lead": False, "left": True}
