"""Which motors are on, as the mocap process hears it from a ground of any version, or from who knows whom."""

import json

import pytest

from mocap.validator import motors_on


def test_the_drones_of_a_ground_are_armed_or_not() -> None:
    drones = [
        {"body": "left", "armed": True, "mode": "OFFBOARD", "heartbeat_age_s": 0.2},
        {"body": "right", "armed": False, "heartbeat_age_s": 7.0},
    ]
    assert motors_on(json.dumps({"phase": "ARMED", "drones": drones})) == {"left": True, "right": False}


@pytest.mark.parametrize(
    "state",
    ["", "[]", "{}", '{"drones": 3}', '{"drones": [{}]}', '{"drones": ["a"]}',
     '{"drones": [{"body": "left", "armed": false, "heartbeat_age_s": null}]}'],
)  # fmt: skip
def test_what_is_no_state_or_without_heartbeat_tells_of_nobody(state: str) -> None:
    assert motors_on(state) == {}
