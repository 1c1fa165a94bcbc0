"""Shapes asked for in the air: GcsCore with fake drones, from the operator's words to the drones' places."""

import numpy as np
import pytest

from formation.messages import Phase, Verb
from tests.gcs.fakes import STAY, FakeLab, accepted, rejected, triangle


def places(lab: FakeLab) -> np.ndarray:
    """The followers, from the leader."""
    return np.array([lab.drones[2].pos, lab.drones[3].pos]) - lab.drones[1].pos


@pytest.fixture
def flying() -> FakeLab:
    lab = FakeLab(triangle(leader=STAY))
    lab.fly()
    lab.run(3.0)
    return lab


def test_a_change_in_flight_brings_each_to_the_slot_nearest_to_it(flying: FakeLab) -> None:
    assert accepted(flying, Verb.SHAPE, "line scale=1.2") == "phase FORMATION, shape line scale=1.2"
    flying.run(6.0)
    np.testing.assert_allclose(places(flying), [[0.0, 0.6, 0.0], [0.0, -0.6, 0.0]], atol=0.02)
    assert any(text.startswith("shape line scale=1.2 in ") for text in flying.events)


def test_a_shape_chosen_while_holding_is_taken_up_at_the_start() -> None:
    lab = FakeLab(triangle(leader=STAY))
    lab.take_off()
    assert accepted(lab, Verb.SHAPE, "line") == "phase HOLD, shape line"
    lab.run(1.0)
    np.testing.assert_allclose(places(lab), [[-0.4, 0.4, 0.0], [-0.4, -0.4, 0.0]], atol=0.03)
    lab.command(Verb.START, Phase.FORMATION)
    lab.run(6.0)
    np.testing.assert_allclose(places(lab), [[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]], atol=0.02)


REFUSED = [
    ("star", "no shape 'star'; known: configured, triangle, line, column, v, circle, grid"),
    ("line scale=0.3", "leaves 0.15 m between lead and left, minimum is 0.20 m"),
    ("line fast", "'fast' is not understood"),
    ("circle scale=30", "its slot would be outside the fence"),
    ("circle scale=0", "scale is 0; it must be above 0"),
    ("circle scale=nan", "scale is 'nan', not a finite number"),
    ("circle scale=1e9", "scale is 1e+09; it must be above 0 and at most 100"),
    ("circle heading=1e9", "heading is 1e+09; it is in degrees, at most a whole turn, 360"),
]


@pytest.mark.parametrize("where", ["before it is seen", "on the floor", "in the air"])
def test_an_impossible_shape_is_rejected_with_its_reason_and_nothing_moves(where: str, flying: FakeLab) -> None:
    lab = flying if where == "in the air" else FakeLab(triangle(leader=STAY))
    if where == "on the floor":
        lab.run(0.5)
    before = places(lab)
    for shape, words in REFUSED:
        assert words in rejected(lab, Verb.SHAPE, shape).text
    lab.run(1.0)
    np.testing.assert_allclose(places(lab), before, atol=0.01)
    accepted(lab, Verb.SHAPE, "line")


def test_a_shape_is_judged_where_the_leaders_trajectory_will_carry_it() -> None:
    """A column behind the leader's start that fits there, but is turned out of the fence: 2 m behind, then beside."""
    turning = {"body": "lead", "sysid": 1, "trajectory": {"kind": "hold", "duration_s": 20.0, "yaw_rate_rad_s": 0.2}}
    lab = FakeLab(triangle(leader=turning))
    lab.run(0.5)
    text = rejected(lab, Verb.SHAPE, "column scale=2.2").text
    assert "right: its slot would be outside the fence, at " in text
    assert "beyond limits.fence." in text
    assert text.endswith(" s along the leader's path")
    lab = FakeLab(triangle(leader=STAY))
    accepted(lab, Verb.SHAPE, "column scale=2.2")
