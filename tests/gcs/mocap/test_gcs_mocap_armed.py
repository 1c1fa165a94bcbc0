"""Which motors are on, as the mocap process hears it from a ground of any version, or from who knows whom."""

import json

import pytest

from gcs.mocap.gate.armed import armed_bodies


def test_the_armed_drones_of_a_ground_are_named():
    drones = [{"body": "left", "armed": True, "mode": "OFFBOARD"}, {"body": "right", "armed": False}]
    assert armed_bodies(json.dumps({"phase": "ARMED", "drones": drones})) == {"left"}


@pytest.mark.parametrize(
    "state", ["", "[]", "null", "{}", '{"drones": 3}', '{"drones": [{}]}', '{"drones": ["a"]}', "\x00"]
)
def test_what_is_no_state_names_nobody(state):
    assert armed_bodies(state) == frozenset()
