from itertools import permutations
from math import pi, sqrt

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from formation.config import FollowerConfig, LabConfig, LeaderConfig
from formation.guidance.patterns import PATTERNS
from formation.guidance.plan import Mode, Plan, Setpoint
from formation.guidance.reference_generator import Generator, add_gap, fleet, references, update
from formation.guidance.reference_generator import start as started
from formation.guidance.shape import Shape
from formation.guidance.trajectory import ACCELERATION_M_S2, braking_s, closing_s
from formation.guidance.transition import Space, Transition, assigned, transition
from formation.maths.arrays import Float
from formation.maths.frames import rotate_about_z

SECOND = 10**9
SPACE = Space(min_separation_m=0.2, clearance_m=0.32, low_m=-0.8, high_m=2.5, speed_m_s=1.0)


def shape_of(slots: Float, name: str = "S") -> Shape:
    return Shape(name, tuple((float(x), float(y), float(z)) for x, y, z in slots), (0.0,) * len(slots))


def at_rest(slots: Float) -> Float:
    motion = np.zeros((len(slots), 3, 4))
    motion[:, 0, :3] = slots
    return motion


def names(n: int) -> list[str]:
    return ["leader", *(f"F{k}" for k in range(n))]


def flown(way: Transition, start: Float, lead: Float) -> list[Float]:
    """Slots and the leader (n + 1, 3, 4) in the leader's frame every 20 ms, as those who set out are led."""
    n = len(start)
    lab = LabConfig(
        leader=LeaderConfig(body="L"),
        followers=tuple(FollowerConfig(body=f"F{k}", sysid=2 + k, offset_m=(0.0, 0.0, 0.0)) for k in range(n)),
    )
    setpoints = (Setpoint(Mode.FORMATION, speed_m_s=SPACE.speed_m_s),) * n
    before, after = Plan(setpoints, shape_of(start, "before")), Plan(setpoints, way.shape, rise_m=way.rise_m)
    generator = _settled(started(before, at_rest(start), 0), before, fleet(lab), at_rest(start), lead)
    generator = update(generator, after, fleet(lab), references(generator, SECOND, lead).lab, lead, SECOND)
    steps = range(round(way.duration_s * 50) + 2)
    bodies = np.zeros((n + 1, 3, 4))
    track = []
    for k in steps:
        bodies[1:] = references(generator, SECOND + k * 20_000_000, lead).slot
        track.append(bodies.copy())
    return track


def _settled(generator: Generator, plan: Plan, who, motion: Float, lead: Float) -> Generator:
    """In the slots of the plan, whatever it took to get there."""
    generator = update(generator, plan, who, motion, np.zeros((3, 4)), -1000 * SECOND)
    np.testing.assert_allclose(references(generator, 0, lead).slot[:, 0, :3], plan.shape.offsets, atol=1e-9)
    return generator


def nearest(track: list[Float]) -> float:
    at = np.array(track)[:, :, 0, :3]
    apart = np.linalg.norm(at[:, :, None] - at[:, None], axis=-1)
    apart[:, np.arange(at.shape[1]), np.arange(at.shape[1])] = np.inf
    return float(apart.min())


@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_no_other_deal_travels_less(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    now, slots = rng.uniform(-2.0, 2.0, (n, 3)), rng.uniform(-2.0, 2.0, (n, 3))
    dealt = assigned(shape_of(slots), now).offsets
    costs = [np.sum((now - slots[list(order)]) ** 2) for order in permutations(range(n))]
    assert np.sum((now - dealt) ** 2) == pytest.approx(min(costs))
    assert sorted(map(tuple, dealt)) == sorted(map(tuple, slots))


def test_headings_go_with_their_slots() -> None:
    shape = Shape("S", ((1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), (0.1, 0.2))
    dealt = assigned(shape, np.array([[-2.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    assert dealt.offset_lead_m == ((-1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    assert dealt.yaw_offset_rad == (0.2, 0.1)


@settings(max_examples=60)
@given(
    st.sampled_from(sorted(PATTERNS)), st.sampled_from(sorted(PATTERNS)), st.integers(1, 20),
    st.floats(0.9, 2.0), st.floats(-pi, pi),
)  # fmt: skip
def test_every_change_that_is_not_refused_keeps_everybody_apart(
    before: str, after: str, n: int, scale: float, heading: float
) -> None:
    start = PATTERNS[before](n, 0.5)
    goal = rotate_about_z(np.array(heading), scale * PATTERNS[after](n, 0.5))
    try:
        way = transition(assigned(shape_of(goal), start), at_rest(start), SPACE, names(n))
    except ValueError:
        reject()
    lead = np.array([[1.0, -2.0, 0.8, 0.4], [0.3, 0.2, 0.0, 0.5], [0.0, 0.1, 0.0, 0.2]])
    track = flown(way, start, lead)
    assert nearest(track) >= SPACE.min_separation_m - 0.005
    assert nearest(track) == pytest.approx(way.separation_m, abs=0.01)
    np.testing.assert_allclose(track[-1][1:, 0, :3], way.shape.offsets, atol=1e-9)
    heights = np.array(track)[:, 1:, 0, 2]
    assert heights.min() >= SPACE.low_m
    assert heights.max() <= SPACE.high_m


@given(st.sampled_from(sorted(PATTERNS)), st.integers(2, 20), st.integers(0, 2**32 - 1))
def test_straight_ways_alone_keep_capts_share_of_the_spacing_between_followers(after: str, n: int, seed: int) -> None:
    """CAPT: starts and goals a spacing apart, dealt for least squares: never nearer than spacing / sqrt(2)."""
    goal = PATTERNS[after](n, 0.5)
    start = PATTERNS["grid"](n, 0.5)[np.random.default_rng(seed).permutation(n)]
    dealt = assigned(shape_of(goal), start).offsets
    share = np.linspace(0.0, 1.0, 200)[:, None, None]
    way = start + share * (dealt - start)
    apart = np.linalg.norm(way[:, :, None] - way[:, None], axis=-1) + 10.0 * np.eye(n)
    assert apart.min() >= 0.5 / sqrt(2.0) - 1e-9


def test_a_way_that_is_clear_is_straight() -> None:
    start = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert transition(shape_of(1.4 * start), at_rest(start), SPACE, names(2)).rise_m == (0.0, 0.0)


def test_one_who_must_cross_the_leader_passes_over_it() -> None:
    start, goal = np.array([[-0.6, 0.0, 0.0]]), np.array([[0.6, 0.0, 0.0]])
    way = transition(shape_of(goal), at_rest(start), SPACE, names(1))
    assert way.rise_m[0] > SPACE.clearance_m
    assert way.separation_m >= SPACE.clearance_m
    assert way.duration_s == pytest.approx(1.875 * 1.2 + 3.4346 * way.rise_m[0])  # peak speeds of unit step and bump


def test_under_a_low_ceiling_it_passes_below_and_in_a_slit_it_is_refused() -> None:
    start, goal = np.array([[-0.6, 0.0, 0.0]]), np.array([[0.6, 0.0, 0.0]])
    below = Space(0.2, 0.32, low_m=-0.8, high_m=0.1, speed_m_s=1.0)
    assert transition(shape_of(goal), at_rest(start), below, names(1)).rise_m[0] < 0.0
    slit = Space(0.2, 0.32, low_m=-0.1, high_m=0.1, speed_m_s=1.0)
    with pytest.raises(ValueError, match=r"on the way to shape S there would be 0\.00 m between leader and F0"):
        transition(shape_of(goal), at_rest(start), slit, names(1))


def test_a_shape_too_tight_is_refused_by_the_names_of_those_who_would_meet() -> None:
    start, goal = np.array([[-1.0, 0.0, 0.0], [-2.0, 0.0, 0.0]]), np.array([[-1.0, 0.0, 0.0], [-1.1, 0.0, 0.0]])
    with pytest.raises(ValueError, match=r"shape S leaves 0\.10 m between F0 and F1, minimum is 0\.20 m"):
        transition(shape_of(goal), at_rest(start), SPACE, names(2))


@given(st.integers(0, 2**32 - 1))
def test_a_change_begun_on_the_way_is_judged_by_the_ways_that_will_be_flown(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start = np.array([[-0.5, 0.5, 0.0], [-0.5, -0.5, 0.0]])
    motion = at_rest(start)
    motion[:, 1, :3], motion[:, 2, :3] = rng.uniform(-0.6, 0.6, (2, 3)), rng.uniform(-1.0, 1.0, (2, 3))
    try:
        way = transition(shape_of(start), motion, SPACE, names(2))
    except ValueError:
        reject()
    least = np.inf
    gap = np.zeros((2, 4, 4))
    gap[:, :3] = motion
    gap[:, 0, :3] -= start
    gap[:, 3, 2] = way.rise_m
    for elapsed_s in np.linspace(0.0, way.duration_s, 300):
        at = np.zeros((3, 3, 4))
        for k in range(2):
            at[k, 0, :3] = start[k]
            add_gap(gap[k], braking_s(gap[k]), elapsed_s, way.duration_s, at[k])
        least = min(least, *(float(np.linalg.norm(at[i, 0] - at[j, 0])) for i, j in ((0, 1), (0, 2), (1, 2))))
    assert least >= SPACE.min_separation_m - 0.005


@given(st.floats(0.0, 4.0), st.floats(-1.5, 1.5), st.floats(0.2, 2.0))
def test_a_way_is_smooth_and_within_its_speed_and_acceleration(distance: float, rise: float, speed: float) -> None:
    gap = np.zeros((4, 4))
    gap[0, :3], gap[3, 2] = (0.6 * distance, -0.8 * distance, 0.0), rise
    duration_s = closing_s(gap, braking_s(gap), speed)
    times = np.linspace(0.0, duration_s, 2001)
    track = np.zeros((len(times), 3, 4))
    for at, elapsed_s in zip(track, times, strict=True):
        add_gap(gap, braking_s(gap), elapsed_s, duration_s, at)
    np.testing.assert_allclose(track[0], [gap[0], np.zeros(4), np.zeros(4)], atol=1e-12)
    np.testing.assert_allclose(track[-1], 0.0, atol=1e-9)
    step = times[1]
    for order in range(2):
        moved = np.diff(track[:, order], axis=0)
        np.testing.assert_allclose(moved, 0.5 * step * (track[1:, order + 1] + track[:-1, order + 1]), atol=2e-5)
    assert np.linalg.norm(track[:, 1], axis=-1).max() <= speed * 1.001
    assert np.linalg.norm(track[:, 2], axis=-1).max() <= ACCELERATION_M_S2 * 1.001
