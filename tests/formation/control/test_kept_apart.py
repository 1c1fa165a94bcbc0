"""Whole flights on which drones are sent into each other: true distances, with the barriers and without."""

import numpy as np
import pytest

from formation.config import Fence, FollowerConfig, LabConfig, LeaderConfig, LimitsConfig
from formation.guidance.plan import Mode, Plan, Setpoint
from formation.guidance.shape import configured
from formation.maths.arrays import Float
from tests.formation.points import Track, fly_points

WIDE = Fence(low_m=(-50.0, -50.0, -0.1), high_m=(50.0, 50.0, 9.0))
FAR = np.array([0.0, 19.0, 1.0])
TOUCHING_M = 0.1


def lab(followers: int, name: str = "paper_40g", speed_m_s: float = 3.0) -> LabConfig:
    return LabConfig(
        leader=LeaderConfig(body="L", profile=name),
        followers=tuple(
            FollowerConfig(body=f"F{k}", sysid=2 + k, profile=name, offset_m=(-0.5 - 0.5 * k, 0.0, 0.0))
            for k in range(followers)
        ),
        limits=LimitsConfig(fence=WIDE, speed_m_s=speed_m_s),
    )


def to_points(config: LabConfig, *points: tuple[float, float, float], speed_m_s: float = 1.0) -> Plan:
    return Plan(tuple(Setpoint(Mode.LAB, point, 0.0, speed_m_s) for point in points), configured(config))


def sent_through_each_other(name: str, speed_m_s: float, without: frozenset[str] = frozenset()) -> Track:
    config = lab(2, name)
    a, b = (-1.0, 0.0, 1.0), (1.0, 0.02, 1.0)
    plan = to_points(config, b, a, speed_m_s=speed_m_s)
    return fly_points(config, lambda t: plan, np.array([FAR, a, b]), 4.0, lambda t: FAR, without=without)


@pytest.mark.parametrize(("name", "speed_m_s"), [("paper_40g", 0.8), ("paper_40g", 3.0), ("px4_quad", 1.5)])
def test_two_sent_through_each_other_go_round_each_other(name: str, speed_m_s: float) -> None:
    track = sent_through_each_other(name, speed_m_s)
    assert track.apart().min() > 0.19
    assert track.pos[:, 1:, 2].min() > 0.9


def test_without_the_separation_filter_they_collide() -> None:
    assert sent_through_each_other("paper_40g", 1.5, frozenset({"separation-filter"})).apart().min() < 0.02


def walked_at(without: frozenset[str] = frozenset()) -> Track:
    """A leader is carried 1.9 m at 1 m/s through the place where a follower is told to stay, 0.8 m off."""
    config = lab(1)
    start, place = np.array([0.0, 0.0, 1.0]), (-0.8, 0.0, 1.0)
    plan = to_points(config, place)
    starts = np.array([start, place])
    return fly_points(
        config, lambda t: plan, starts, 3.0, lambda t: start - [min(max(t - 0.5, 0.0), 1.9), 0.05, 0.0], without=without
    )


def test_a_follower_gives_way_to_a_leader_that_walks_at_it() -> None:
    assert walked_at().apart().min() > 0.2
    assert walked_at(frozenset({"separation-filter"})).apart().min() < TOUCHING_M


@pytest.mark.parametrize("draw", [0, *(pytest.param(n, marks=pytest.mark.nightly) for n in (1, 2, 3))])
def test_twenty_that_cross_in_one_point_miss_each_other_and_arrive(draw: int) -> None:
    config, rng = lab(20), np.random.default_rng(draw)
    angle = 2.0 * np.pi * rng.permutation(20) / 20.0
    ring = np.column_stack([2.2 * np.cos(angle), 2.2 * np.sin(angle), np.full(20, 1.0)])
    plan = to_points(config, *((-x, -y, z) for x, y, z in ring.tolist()), speed_m_s=1.5)
    track = fly_points(config, lambda t: plan, np.vstack([FAR, ring]), 9.0, lambda t: FAR)
    assert track.apart().min() > 0.16
    left_m = np.linalg.norm(track.pos[-1, 1:] - ring * [-1.0, -1.0, 1.0], axis=-1)
    assert left_m.max() < 0.3


@pytest.mark.parametrize("name", ["paper_40g", "px4_quad"])
def test_two_taken_for_each_other_for_a_tenth_of_a_second_do_not_touch(name: str) -> None:
    config = lab(2, name)
    places = ((-0.25, 0.0, 1.0), (0.25, 0.0, 1.0))
    plan = to_points(config, *places)

    def confused(t_s: float, pos: Float, q: Float) -> tuple[Float, Float, Float]:
        order = [0, 2, 1] if 0.5 <= t_s < 0.599 else [0, 1, 2]
        return pos[order], q[order], np.ones(3, dtype=np.bool_)

    track = fly_points(config, lambda t: plan, np.array([FAR, *places]), 2.0, lambda t: FAR, confused)
    assert track.apart().min() > TOUCHING_M


def hurried(without: frozenset[str] = frozenset()) -> float:
    """The fastest a drone gets whose reference goes at 2 m/s where 1 m/s is the limit."""
    config = lab(1, speed_m_s=1.0)
    plan = to_points(config, (6.0, 0.0, 1.0), speed_m_s=2.0)
    track = fly_points(config, lambda t: plan, np.array([FAR, [-6.0, 0.0, 1.0]]), 6.0, lambda t: FAR, without=without)
    return float(track.speeds()[:, 1].max())


def test_no_reference_drives_a_drone_beyond_the_speed_limit() -> None:
    assert hurried() < 1.02
    assert hurried(frozenset({"speed-limit"})) > 1.5


def past_one_that_is_lost(without: frozenset[str] = frozenset()) -> float:
    """How near one comes to where another, hovering, was last seen 0.2 s after it set out for a place beyond."""
    config = lab(2)
    lost, start, beyond = (0.0, 0.0, 1.0), (-1.5, 0.0, 1.0), (1.5, 0.0, 1.0)
    before, after = to_points(config, lost, start), to_points(config, lost, beyond)
    track = fly_points(
        config, lambda t: before if t < 0.5 else after, np.array([FAR, lost, start]), 5.0, lambda t: FAR,
        lambda t, pos, q: (pos, q, np.array([True, t < 0.7, True])), without,
    )  # fmt: skip
    return float(np.linalg.norm(track.pos[:, 2] - lost, axis=-1).min())


def test_one_stops_short_of_where_another_was_lost() -> None:
    """The separation, and the 0.3 m within which the lost one comes to rest."""
    assert past_one_that_is_lost() > 0.49
    assert past_one_that_is_lost(frozenset({"keep-out"})) < 0.4


def behind_a_leader_that_seems(turned_rad: float, moved_m: float, lasting_s: float) -> tuple[Track, Float]:
    """Two in their slots; the leader, at rest, is seen turned and elsewhere for a time. Their true ways from there."""
    slots = ((-0.6, 0.4, 0.0), (-0.6, -0.4, 0.0))
    config = LabConfig(
        leader=LeaderConfig(body="L"),
        followers=tuple(FollowerConfig(body=f"F{k}", sysid=2 + k, offset_m=slot) for k, slot in enumerate(slots)),
        limits=LimitsConfig(fence=WIDE),
    )
    plan = Plan((Setpoint(Mode.FORMATION),) * 2, configured(config))
    leader = np.array([0.0, 0.0, 1.0])

    def wrong(t_s: float, pos: Float, q: Float) -> tuple[Float, Float, Float]:
        if 0.5 <= t_s < 0.5 + lasting_s - 1e-9:
            turn = np.array([np.cos(turned_rad / 2.0), 0.0, 0.0, np.sin(turned_rad / 2.0)])
            pos, q = pos + np.array([[moved_m, 0.0, 0.0], [0.0] * 3, [0.0] * 3]), np.vstack([turn, q[1:]])
        return pos, q, np.ones(3, dtype=np.bool_)

    starts = np.vstack([leader, leader + slots])
    track = fly_points(config, lambda t: plan, starts, 2.5, lambda t: leader, wrong)
    return track, np.linalg.norm(track.pos[:, 1:] - starts[1:], axis=-1)


@pytest.mark.parametrize(
    ("turned_rad", "moved_m", "lasting_s", "astray_m"), [(np.pi, 0.0, 0.2, 0.15), (0.0, 1.0, 0.6, 0.45)]
)
def test_a_leader_seen_wrong_leads_nobody_away(
    turned_rad: float, moved_m: float, lasting_s: float, astray_m: float
) -> None:
    """They were led at 5 m/s out of the room; what is asked of them is now 0.5 m/s, while it lasts."""
    track, away_m = behind_a_leader_that_seems(turned_rad, moved_m, lasting_s)
    assert away_m.max() < astray_m
    assert away_m[-1].max() < 0.05
    assert track.speeds()[:, 1:].max() < 1.0
    assert track.apart().min() > 0.4
