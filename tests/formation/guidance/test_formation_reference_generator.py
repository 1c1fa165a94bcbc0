import numpy as np
import pytest

from formation.config import FollowerConfig, LabConfig, LeaderConfig, TrajectoryConfig
from formation.guidance.plan import IDLE, Leg, Mode, Plan, Target
from formation.guidance.reference_generator import Course, crew, depart, evaluate, steer
from formation.guidance.shape import Shape, configured
from formation.maths.arrays import Float

LAB = LabConfig(
    leader=LeaderConfig(body="L", sysid=1, trajectory=TrajectoryConfig(kind="line", duration_s=4.0)),
    followers=(
        FollowerConfig(body="A", sysid=2, offset_m=(-0.4, 0.4, 0.0)),
        FollowerConfig(body="B", sysid=3, offset_m=(-0.4, -0.4, 0.0), yaw_offset_rad=0.5),
    ),
)
WHO = crew(LAB)
SHAPE = configured(LAB)
SECOND = 10**9


def standing(*points: tuple[float, float, float]) -> Float:
    motion = np.zeros((len(points), 3, 4))
    motion[:, 0, :3] = points
    return motion


START = standing((0.0, 0.0, 0.0), (-0.5, 0.5, 0.0), (-0.5, -0.5, 0.0))


def everyone(leg: Leg, start_ns: int | None = None, shape: Shape = SHAPE) -> Plan:
    return Plan((leg,) * 3, shape, start_ns)


def lab_leg(*target: float | None) -> Leg:
    x, y, z = target
    goal: Target = (x, y, z)
    return Leg(Mode.LAB, goal)


def fly(course: Course, plan: Plan, from_s: float, to_s: float, lead: Float) -> tuple[Course, list[Float]]:
    """Vehicles that follow their reference exactly; lab references every 10 ms."""
    path = []
    for k in range(round(from_s * 100), round(to_s * 100)):
        t_ns = k * 10_000_000
        motion = evaluate(course, t_ns, lead).lab
        course = steer(course, plan, WHO, motion, lead, t_ns)
        path.append(evaluate(course, t_ns, lead).lab.copy())
    return course, path


def smooth(path: list[Float]) -> None:
    """Positions, velocities and accelerations follow from each other, with no jump."""
    track = np.array(path)
    for order, bound in ((0, 0.03), (1, 0.3)):
        step = np.diff(track[:, :, order], axis=0)
        predicted = 0.01 * 0.5 * (track[:-1, :, order + 1] + track[1:, :, order + 1])
        assert np.abs(step - predicted).max() < bound * 0.02


def airborne(height_m: float = 0.3) -> Course:
    up = START.copy()
    up[:, 0, 2] = height_m
    plan = everyone(lab_leg(None, None, height_m))
    return steer(depart(plan, up, 0), plan, WHO, up, up[0], 0)


def test_idle_vehicles_are_led_where_they_stand() -> None:
    course = steer(depart(everyone(IDLE), START, 0), everyone(IDLE), WHO, START, START[0], 0)
    np.testing.assert_allclose(evaluate(course, SECOND, START[0]).lab[:, 0], START[:, 0])
    assert not course.airborne.any()


def test_take_off_begins_at_lift_off_and_not_before() -> None:
    course = depart(everyone(IDLE), START, 0)
    course = steer(course, everyone(IDLE), WHO, START, START[0], 0)
    climb = everyone(lab_leg(None, None, 0.5))
    course = steer(course, climb, WHO, START, START[0], SECOND)
    assert course.release_ns.tolist() == [SECOND] * 3
    course = steer(course, climb, WHO, START, START[0], 2 * SECOND)
    assert not course.airborne.any()
    assert course.release_ns.tolist() == [SECOND] * 3
    lifted = START.copy()
    lifted[:, 0, 2], lifted[:, 1, 2] = 0.03, 0.2
    course = steer(course, climb, WHO, lifted, lifted[0], 3 * SECOND)
    assert course.airborne.all()
    np.testing.assert_allclose(evaluate(course, 3 * SECOND, lifted[0]).lab, lifted, atol=1e-12)
    arrived = evaluate(course, 30 * SECOND, lifted[0]).lab
    np.testing.assert_allclose(arrived[:, 0, 2], 0.5)
    np.testing.assert_allclose(arrived[:, 1:], 0.0, atol=1e-12)


def test_joining_the_formation_ends_in_the_slots_of_a_moving_turning_leader() -> None:
    lead = np.array([[1.0, 2.0, 0.3, 0.7], [0.3, -0.2, 0.0, 1.0], [0.1, 0.0, 0.0, 0.2]])
    plan = Plan((lab_leg(0.0, 0.0, 0.3), Leg(Mode.FORMATION), Leg(Mode.FORMATION)), SHAPE)
    course = airborne()
    before = evaluate(course, SECOND, lead).lab
    course = steer(course, plan, WHO, before, lead, SECOND)
    at_once = evaluate(course, SECOND, lead)
    np.testing.assert_allclose(at_once.lab, before, atol=1e-9)
    settled = evaluate(course, 30 * SECOND, lead)
    np.testing.assert_allclose(settled.slot[1:, 0, :3], SHAPE.offsets)
    np.testing.assert_allclose(settled.slot[1:, 1:], 0.0, atol=1e-9)
    assert settled.lab[2, 0, 3] == pytest.approx(0.7 + 0.5)
    assert course.in_formation.tolist() == [False, True, True]


def test_every_change_of_plan_is_smooth() -> None:
    lead = standing((0.0, 0.0, 0.3))[0]
    wide = Shape("wide", ((-0.8, 0.8, 0.1), (-0.8, -0.8, 0.1)), (0.0, 0.0))
    course, whole = airborne(), []
    for plan, begin, end in (
        (everyone(Leg(Mode.FORMATION)), 0.0, 1.0),
        (everyone(Leg(Mode.FORMATION), SECOND), 1.0, 3.0),
        (everyone(Leg(Mode.FORMATION), SECOND, wide), 3.0, 4.0),
        (everyone(lab_leg(None, None, None)), 4.0, 4.3),
        (everyone(lab_leg(None, None, -0.3)), 4.3, 9.0),
    ):
        course, path = fly(course, plan, begin, end, lead)
        whole += path
    smooth(whole)


def test_hold_brakes_and_then_stays() -> None:
    moving = START.copy()
    moving[:, 0, 2], moving[:, 1, 0] = 0.5, 1.0
    hold = everyone(lab_leg(None, None, None))
    course = steer(depart(hold, moving, 0), hold, WHO, moving, moving[0], 0)
    rest = evaluate(course, 20 * SECOND, moving[0]).lab
    np.testing.assert_allclose(rest[:, 1:], 0.0, atol=1e-12)
    assert (rest[:, 0, 0] > moving[:, 0, 0]).all()
    assert (rest[:, 0, 0] < moving[:, 0, 0] + 1.0).all()


def test_joiners_arrive_together() -> None:
    course = airborne()
    plan = Plan((lab_leg(0.0, 0.0, 0.3), Leg(Mode.FORMATION), Leg(Mode.FORMATION)), SHAPE)
    far = evaluate(course, 0, START[0]).lab
    far[1, 0, 0] -= 2.0
    course = steer(depart(plan, far, 0), plan, WHO, far, far[0], 0)
    assert course.gap_s[1] == course.gap_s[2]


def test_an_unchanged_plan_keeps_the_course() -> None:
    course = airborne()
    again = steer(course, course.plan, WHO, START, START[0], SECOND)
    assert again is course


def test_the_way_round_is_the_short_one() -> None:
    turned = airborne()
    motion = evaluate(turned, 0, START[0]).lab
    motion[:, 0, 3] = 3.0
    plan = everyone(Leg(Mode.LAB, (0.0, 0.0, 0.3), -3.0))
    course = steer(depart(plan, motion, 0), plan, WHO, motion, motion[0], 0)
    headings = [evaluate(course, k * SECOND // 10, motion[0]).lab[0, 0, 3] for k in range(100)]
    assert np.ptp(headings) < 0.3
