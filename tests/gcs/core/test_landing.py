import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from formation.config import LimitsConfig
from formation.messages import Phase, Verb
from gcs.landing import landing_spots
from tests.gcs.fakes import FakeLab, triangle

LIMITS = LimitsConfig()
CLEAR_M = 1.5 * LIMITS.min_separation_m


def test_the_upper_one_of_two_comes_down_beside_the_lower_and_who_is_alone_under_itself():
    spots = landing_spots(np.array([[0.5, 0.5, 1.2], [0.5, 0.5, 0.4], [-0.4, 0.4, 0.9]]), LIMITS)
    assert spots[1:].tolist() == [[0.5, 0.5], [-0.4, 0.4]]
    assert CLEAR_M <= np.linalg.norm(spots[0] - spots[1]) < 2.0 * CLEAR_M


@given(st.lists(st.tuples(st.floats(-2.4, 2.4), st.floats(-1.9, 1.9), st.floats(0.2, 2.0)), min_size=1, max_size=6))
def test_no_two_spots_are_close_and_each_is_inside_the_fence(places):
    spots = landing_spots(np.array(places), LIMITS)
    assert (np.abs(spots) <= np.array([2.4, 1.9]) + 1e-9).all()
    for a, b in itertools.combinations(spots, 2):
        assert np.linalg.norm(a - b) >= CLEAR_M - 1e-9


def test_a_stack_lands_side_by_side_and_keeps_apart_on_the_way():
    lab = FakeLab(
        triangle(
            followers=[{"body": "left", "sysid": 2, "offset_m": (0.0, 0.0, 0.6)}],
            leader={"body": "lead", "sysid": 1, "trajectory": {"kind": "hold"}},
        )
    )
    lab.drones[2].pos = np.array([-0.6, 0.0, 0.0])
    lab.fly()
    for _ in range(800):
        lab.step()
        if abs(lab.drones[2].pos - lab.drones[1].pos - [0.0, 0.0, 0.6]).max() < 0.03:
            break
    lab.command(Verb.LAND, Phase.LAND)
    nearest_m = np.inf
    while lab.phase is Phase.LAND:
        lab.step()
        nearest_m = min(nearest_m, np.linalg.norm(lab.drones[1].pos - lab.drones[2].pos))
    assert nearest_m >= lab.config.limits.min_separation_m
    assert np.linalg.norm(lab.drones[1].pos - lab.drones[2].pos) >= 1.2 * lab.config.limits.min_separation_m
    assert lab.drones[1].pos[2] == lab.drones[2].pos[2] == 0.0
