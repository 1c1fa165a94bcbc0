"""The leader as it is followed: the estimate while that moves as leaders do, and gently back to it after a step."""

import numpy as np
import pytest

from formation.guidance.followed_leader import FollowedLeader, as_estimated, follow, shifted
from formation.maths.arrays import Float
from formation.maths.records import Rows

DT_NS = 10_000_000
LIMITS = (3.0, 0.5)
ARM_M = 0.5


def motion(pos: tuple = (0.0, 0.0, 1.0, 0.0), vel: tuple = (0.0,) * 4, acc: tuple = (0.0,) * 4) -> Float:
    return np.array([pos, vel, acc])


def followed(leads: list[Float], arm_m: float = ARM_M) -> list[Rows[FollowedLeader]]:
    """A frame every 10 ms, from the first estimate on."""
    out = [as_estimated(leads[0], 0)]
    for k, lead in enumerate(leads[1:], 1):
        out.append(follow(out[-1], lead, k * DT_NS, arm_m, LIMITS))
    return out


def slot_speeds(path: list[Rows[FollowedLeader]]) -> Float:
    """The most that any slot may move from frame to frame, m/s: the leader's way, and its turn at the longest arm."""
    moved = np.diff([at["motion"][0, 0] for at in path], axis=0)
    return (np.linalg.norm(moved[:, :3], axis=1) + ARM_M * np.abs(moved[:, 3])) / 0.01


def test_a_leader_that_moves_as_leaders_do_is_the_estimate_bit_for_bit() -> None:
    """1.5 m/s on a circle of 0.5 m while it turns at 2 rad/s, with a millimetre of noise: 2.5 m/s at the slots."""
    rng, leads = np.random.default_rng(2), []
    for k in range(200):
        t = 0.01 * k
        turn = np.array([np.cos(3.0 * t), np.sin(3.0 * t)])
        lead = motion((*(0.5 * turn), 1.0, 2.0 * t), (-1.5 * turn[1], 1.5 * turn[0], 0.0, 2.0))
        leads.append(lead + 1e-3 * rng.standard_normal((3, 4)))
    for at, lead in zip(followed(leads), leads, strict=True):
        assert np.array_equal(at["motion"][0], lead)
        assert not at["is_shifted"][0]
        ahead = lead.copy()
        shifted(at, int(at["t_ns"][0]) + 5 * DT_NS, ahead)
        assert np.array_equal(ahead, lead)


STEPS = {"half a turn": (0.0, 0.0, 0.0, np.pi), "a metre": (1.0, 0.0, 0.0, 0.0), "up": (0.0, 0.0, 0.5, 0.0)}


@pytest.mark.parametrize("name", STEPS)
def test_a_step_is_made_up_for_gently_and_followed_again(name: str) -> None:
    """At 0.5 m/s and 2.5 m/s^2 of a slot; what it takes is the way at that speed, and its ramps."""
    step = np.array(STEPS[name])
    leads = [motion()] * 5 + [motion(tuple(np.array([0.0, 0.0, 1.0, 0.0]) + step))] * 500
    path = followed(leads)
    assert slot_speeds(path)[:-200].max() < 0.52
    velocity = np.array([at["motion"][0, 1] for at in path])
    jolts = np.linalg.norm(np.diff(velocity[:, :3], axis=0), axis=1) + ARM_M * np.abs(np.diff(velocity[:, 3]))
    away = np.array([bool(at["is_shifted"][0]) for at in path])
    assert jolts[: np.flatnonzero(away)[-1]].max() < 2.5 * 0.01 + 1e-9
    way = np.linalg.norm(step[:3]) + ARM_M * abs(step[3])
    assert way / 0.5 <= 0.01 * away.sum() < way / 0.5 + 1.0
    assert np.array_equal(path[-1]["motion"][0], leads[-1])


def test_a_step_that_is_taken_back_has_moved_slots_little() -> None:
    """0.2 s at 2.5 m/s^2 are 5 cm, and as much to brake."""
    leads = [motion()] * 5 + [motion((0.0, 0.0, 1.0, np.pi))] * 20 + [motion()] * 200
    turned = np.array([at["motion"][0, 0, 3] for at in followed(leads)])
    assert 0.04 < ARM_M * turned.max() < 0.11
    assert turned[-1] == 0.0


def test_an_estimate_that_races_is_not_raced_after() -> None:
    """As an observer makes of a step: 30 rad/s and 12 m/s for a tenth of a second, then rest where it began."""
    racing = [motion((0.12 * k, 0.0, 1.0, 0.3 * k), (12.0, 0.0, 0.0, 30.0)) for k in range(10)]
    path = followed([motion()] * 3 + racing + [motion()] * 300)
    assert slot_speeds(path).max() < 0.6
    assert not path[-1]["is_shifted"][0]


def test_a_leader_too_fast_for_its_slots_is_followed_at_the_limit() -> None:
    """It gains 4 m/s^2 for a second."""
    times = np.arange(400) * 0.01
    speeds = np.minimum(4.0 * times, 4.0)
    places = np.where(times < 1.0, 2.0 * times**2, 2.0 + 4.0 * (times - 1.0))
    path = followed([motion((x, 0.0, 1.0, 0.0), (v, 0.0, 0.0, 0.0)) for x, v in zip(places, speeds, strict=True)])
    assert 2.9 < slot_speeds(path)[-1] <= 3.0
    assert slot_speeds(path).max() < 3.0 + 0.02


def test_where_nobody_is_to_follow_the_leader_is_the_estimate() -> None:
    path = followed([motion(), motion((9.0, 0.0, 1.0, 3.0))], -1.0)
    assert np.array_equal(path[-1]["motion"][0, 0], [9.0, 0.0, 1.0, 3.0])


def test_what_is_predicted_of_it_goes_on_from_where_it_is_followed() -> None:
    """p + h v + h^2 a / 2 of the followed motion, whatever the estimate's own are."""
    was = motion((0.0, 0.0, 1.0, 0.0), (0.2, 0.0, 0.0, 0.0))
    lead = motion((2.0, 1.0, 1.0, 2.0), (5.0, -3.0, 0.0, 20.0), (1.0, 2.0, 3.0, 4.0))
    at = followed([was, lead])[-1]
    h = 0.07
    ahead = np.array([lead[0] + h * lead[1] + 0.5 * h * h * lead[2], lead[1] + h * lead[2], lead[2]])
    shifted(at, DT_NS + 70_000_000, ahead)
    p, v, a = at["motion"][0]
    np.testing.assert_allclose(ahead, [p + h * v + 0.5 * h * h * a, v + h * a, a], atol=1e-12)
    assert np.linalg.norm(v[:3] - was[1, :3]) + ARM_M * abs(v[3]) == pytest.approx(2.5 * 0.01)
