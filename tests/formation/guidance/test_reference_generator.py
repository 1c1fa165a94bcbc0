import numpy as np
import pytest

from formation.config import FollowerConfig, LabConfig, LeaderConfig, TrajectoryConfig
from formation.guidance.plan import IDLE, Mode, Plan, Setpoint, Target
from formation.guidance.reference_generator import Generator, fleet, references, start, update
from formation.guidance.shape import Shape, configured
from formation.maths.arrays import Float

LAB = LabConfig(
    leader=LeaderConfig(body="L", sysid=1, trajectory=TrajectoryConfig(kind="line", duration_s=4.0)),
    followers=(
        FollowerConfig(body="A", sysid=2, offset_m=(-0.4, 0.4, 0.0)),
        FollowerConfig(body="B", sysid=3, offset_m=(-0.4, -0.4, 0.0), yaw_offset_rad=0.5),
    ),
)
WHO = fleet(LAB)
SHAPE = configured(LAB)
SECOND = 10**9


def standing(*points: tuple[float, float, float]) -> Float:
    motion = np.zeros((len(points), 3, 4))
    motion[:, 0, :3] = points
    return motion


START = standing((0.0, 0.0, 0.0), (-0.5, 0.5, 0.0), (-0.5, -0.5, 0.0))


def everyone(setpoint: Setpoint, start_ns: int | None = None, shape: Shape = SHAPE) -> Plan:
    return Plan((setpoint,) * 3, shape, start_ns)


def lab_setpoint(*target: float | None) -> Setpoint:
    x, y, z = target
    goal: Target = (x, y, z)
    return Setpoint(Mode.LAB, goal)


def fly(generator: Generator, plan: Plan, from_s: float, to_s: float, lead: Float) -> tuple[Generator, list[Float]]:
    """Vehicles that follow their reference exactly; lab references every 10 ms."""
    path = []
    for k in range(round(from_s * 100), round(to_s * 100)):
        t_ns = k * 10_000_000
        motion = references(generator, t_ns, lead).lab
        generator = update(generator, plan, WHO, motion, lead, t_ns)
        path.append(references(generator, t_ns, lead).lab.copy())
    return generator, path


def smooth(path: list[Float]) -> None:
    """Positions, velocities and accelerations follow from each other, with no jump."""
    track = np.array(path)
    for order, bound in ((0, 0.03), (1, 0.3)):
        step = np.diff(track[:, :, order], axis=0)
        predicted = 0.01 * 0.5 * (track[:-1, :, order + 1] + track[1:, :, order + 1])
        assert np.abs(step - predicted).max() < bound * 0.02


def airborne(height_m: float = 0.3) -> Generator:
    up = START.copy()
    up[:, 0, 2] = height_m
    plan = everyone(lab_setpoint(None, None, height_m))
    return update(start(plan, up, 0), plan, WHO, up, up[0], 0)


def test_idle_vehicles_are_led_where_they_stand() -> None:
    generator = update(start(everyone(IDLE), START, 0), everyone(IDLE), WHO, START, START[0], 0)
    np.testing.assert_allclose(references(generator, SECOND, START[0]).lab[:, 0], START[:, 0])
    assert not generator.airborne.any()


def test_take_off_begins_at_lift_off_and_not_before() -> None:
    generator = start(everyone(IDLE), START, 0)
    generator = update(generator, everyone(IDLE), WHO, START, START[0], 0)
    climb = everyone(lab_setpoint(None, None, 0.5))
    generator = update(generator, climb, WHO, START, START[0], SECOND)
    assert generator.vehicles["release_ns"].tolist() == [SECOND] * 3
    generator = update(generator, climb, WHO, START, START[0], 2 * SECOND)
    assert not generator.airborne.any()
    assert generator.vehicles["release_ns"].tolist() == [SECOND] * 3
    lifted = START.copy()
    lifted[:, 0, 2], lifted[:, 1, 2] = 0.03, 0.2
    generator = update(generator, climb, WHO, lifted, lifted[0], 3 * SECOND)
    assert generator.airborne.all()
    np.testing.assert_allclose(references(generator, 3 * SECOND, lifted[0]).lab, lifted, atol=1e-12)
    arrived = references(generator, 30 * SECOND, lifted[0]).lab
    np.testing.assert_allclose(arrived[:, 0, 2], 0.5)
    np.testing.assert_allclose(arrived[:, 1:], 0.0, atol=1e-12)


def test_joining_the_formation_ends_in_the_slots_of_a_moving_turning_leader() -> None:
    lead = np.array([[1.0, 2.0, 0.3, 0.7], [0.3, -0.2, 0.0, 1.0], [0.1, 0.0, 0.0, 0.2]])
    plan = Plan((lab_setpoint(0.0, 0.0, 0.3), Setpoint(Mode.FORMATION), Setpoint(Mode.FORMATION)), SHAPE)
    generator = airborne()
    before = references(generator, SECOND, lead).lab
    generator = update(generator, plan, WHO, before, lead, SECOND)
    at_once = references(generator, SECOND, lead)
    np.testing.assert_allclose(at_once.lab, before, atol=1e-9)
    settled = references(generator, 30 * SECOND, lead)
    np.testing.assert_allclose(settled.slot[1:, 0, :3], SHAPE.offsets)
    np.testing.assert_allclose(settled.slot[1:, 1:], 0.0, atol=1e-9)
    assert settled.lab[2, 0, 3] == pytest.approx(0.7 + 0.5)
    assert generator.in_formation.tolist() == [False, True, True]


def test_every_change_of_plan_is_smooth() -> None:
    lead = standing((0.0, 0.0, 0.3))[0]
    wide = Shape("wide", ((-0.8, 0.8, 0.1), (-0.8, -0.8, 0.1)), (0.0, 0.0))
    generator, whole = airborne(), []
    for plan, begin, end in (
        (everyone(Setpoint(Mode.FORMATION)), 0.0, 1.0),
        (everyone(Setpoint(Mode.FORMATION), SECOND), 1.0, 3.0),
        (everyone(Setpoint(Mode.FORMATION), SECOND, wide), 3.0, 4.0),
        (everyone(lab_setpoint(None, None, None)), 4.0, 4.3),
        (everyone(lab_setpoint(None, None, -0.3)), 4.3, 9.0),
    ):
        generator, path = fly(generator, plan, begin, end, lead)
        whole += path
    smooth(whole)


def test_hold_brakes_and_then_stays() -> None:
    moving = START.copy()
    moving[:, 0, 2], moving[:, 1, 0] = 0.5, 1.0
    hold = everyone(lab_setpoint(None, None, None))
    generator = update(start(hold, moving, 0), hold, WHO, moving, moving[0], 0)
    rest = references(generator, 20 * SECOND, moving[0]).lab
    np.testing.assert_allclose(rest[:, 1:], 0.0, atol=1e-12)
    assert (rest[:, 0, 0] > moving[:, 0, 0]).all()
    assert (rest[:, 0, 0] < moving[:, 0, 0] + 1.0).all()


def test_joiners_arrive_together() -> None:
    generator = airborne()
    plan = Plan((lab_setpoint(0.0, 0.0, 0.3), Setpoint(Mode.FORMATION), Setpoint(Mode.FORMATION)), SHAPE)
    far = references(generator, 0, START[0]).lab
    far[1, 0, 0] -= 2.0
    generator = update(start(plan, far, 0), plan, WHO, far, far[0], 0)
    assert generator.vehicles["gap_s"][1] == generator.vehicles["gap_s"][2]


def test_an_unchanged_plan_keeps_the_course() -> None:
    generator = airborne()
    again = update(generator, generator.plan, WHO, START, START[0], SECOND)
    assert again is generator


def test_the_way_round_is_the_short_one() -> None:
    turned = airborne()
    motion = references(turned, 0, START[0]).lab
    motion[:, 0, 3] = 3.0
    plan = everyone(Setpoint(Mode.LAB, (0.0, 0.0, 0.3), -3.0))
    generator = update(start(plan, motion, 0), plan, WHO, motion, motion[0], 0)
    headings = [references(generator, k * SECOND // 10, motion[0]).lab[0, 0, 3] for k in range(100)]
    assert np.ptp(headings) < 0.3


def test_those_who_wait_on_the_floor_are_led_where_they_are_now() -> None:
    generator = update(start(everyone(IDLE), START, 0), everyone(IDLE), WHO, START, START[0], 0)
    climb = everyone(lab_setpoint(None, None, 0.5))
    pushed = START.copy()
    pushed[:, 0] += [0.1, -0.2, 0.005, 0.3]
    for k, motion in enumerate((START, pushed)):
        generator = update(generator, climb, WHO, motion, motion[0], (1 + k) * SECOND)
        np.testing.assert_allclose(references(generator, (5 + k) * SECOND, motion[0]).lab[:, 0], motion[:, 0])
    assert not generator.airborne.any()


def test_a_target_outside_the_fence_is_drawn_a_decimetre_inside_but_for_the_floor() -> None:
    """The fence is (-2.5, -2, -0.1) to (2.5, 2, 2.3)."""
    for target, drawn in (((9.0, -9.0, 9.0), (2.4, -1.9, 2.2)), ((-9.0, 9.0, -0.3), (-2.4, 1.9, -0.3))):
        generator = update(airborne(), everyone(lab_setpoint(*target)), WHO, START, START[0], SECOND)
        there = references(generator, 90 * SECOND, START[0]).lab
        np.testing.assert_allclose(there[:, 0, :3], [drawn] * 3)


def test_what_is_asked_anew_begins_anew_and_nothing_else_does() -> None:
    """A leader begins again with its trajectory's start, followers with the shape, anybody with another setpoint."""
    formed = everyone(Setpoint(Mode.FORMATION), SECOND)
    wide = Shape("wide", ((-0.8, 0.8, 0.1), (-0.8, -0.8, 0.1)), (0.0, 0.0))
    generator = update(airborne(), formed, WHO, START, START[0], SECOND)
    begun = {
        "start": update(generator, everyone(Setpoint(Mode.FORMATION), 2 * SECOND), WHO, START, START[0], 2 * SECOND),
        "shape": update(generator, everyone(Setpoint(Mode.FORMATION), SECOND, wide), WHO, START, START[0], 2 * SECOND),
        "setpoint": update(generator, Plan((*formed.setpoints[:2], lab_setpoint(0.0, 0.0, 0.4)), SHAPE, SECOND), WHO,
                           START, START[0], 2 * SECOND),
    }  # fmt: skip
    assert generator.vehicles["gap_ns"].tolist() == [SECOND] * 3
    assert begun["start"].vehicles["gap_ns"].tolist() == [2 * SECOND, SECOND, SECOND]
    assert begun["shape"].vehicles["gap_ns"].tolist() == [SECOND, 2 * SECOND, 2 * SECOND]
    assert begun["setpoint"].vehicles["gap_ns"].tolist() == [SECOND, SECOND, 2 * SECOND]


def test_a_leader_off_its_trajectorys_start_takes_three_seconds_to_join_it() -> None:
    for path, seconds in ((TrajectoryConfig(kind="line", duration_s=4.0), 0.6), (TrajectoryConfig(kind="circle"), 3.0)):
        who = fleet(LAB.model_copy(update={"leader": LAB.leader.model_copy(update={"trajectory": path})}))
        generator = update(airborne(), everyone(Setpoint(Mode.FORMATION), SECOND), who, START, START[0], SECOND)
        assert generator.vehicles["gap_s"][0] == pytest.approx(seconds)


def test_who_holds_where_its_reference_fell_ahead_of_it_stops_above_the_floor() -> None:
    """Led down at 2.9 m/s by a leader that falls, itself 0.4 m above that and at 1.3 m/s: it has 0.8 m to stop in."""
    generator = airborne(1.0)
    formed = everyone(Setpoint(Mode.FORMATION))
    falling = standing((0.0, 0.0, 0.43))[0]
    falling[1, 2], falling[2, 2] = -2.9, -9.8
    generator = update(generator, formed, WHO, references(generator, 0, falling).lab, falling, SECOND)
    own = references(generator, 60 * SECOND, falling).lab.copy()
    own[1:, 0, 2], own[1:, 1, 2], own[1:, 2, 2] = 0.83, -1.3, -5.0
    assert references(generator, 60 * SECOND, falling).lab[1:, 0, 2] == pytest.approx(0.43)
    for setpoint, rest_m in ((lab_setpoint(None, None, None), 0.1), (lab_setpoint(None, None, -1.0), -1.0)):
        held = update(generator, everyone(setpoint), WHO, own, falling, 60 * SECOND)
        track = np.array([references(held, 60 * SECOND + k * SECOND // 100, falling).lab[1:] for k in range(100)])
        np.testing.assert_allclose(track[0, :, :2], own[1:, :2], atol=1e-9)
        assert np.abs(track[:, :, 2, 2]).max() <= 4.0 + (0.0 if rest_m > 0.0 else 2.5)  # to land it sets out as well
        reached = track[track[:, :, 0, 2] <= 0.1][:, 1, 2]
        assert reached.min(initial=0.0) > -0.7
        rest = references(held, 90 * SECOND, falling).lab
        assert (rest[1:, 0, 2] >= rest_m - 1e-9).all()


def test_who_keeps_to_its_reference_is_held_by_that() -> None:
    """An error of tracking or of the estimate makes no jump."""
    generator = airborne()
    own = references(generator, SECOND, START[0]).lab + 0.05
    held = update(generator, everyone(lab_setpoint(None, None, None)), WHO, own, START[0], SECOND)
    before, after = (references(which, SECOND, START[0]).lab for which in (generator, held))
    np.testing.assert_allclose(after, before, atol=1e-12)


def test_a_velocity_is_taken_up_smoothly_kept_exactly_and_braked_from() -> None:
    """The braking time from 0.4 m/s is 0.6 s, and so is that of taking it up."""
    lead, here, wanted = np.zeros((3, 4)), Setpoint(Mode.LAB), (0.4, -0.1, 0.0, 0.5)
    moving = everyone(Setpoint(Mode.LAB, (None, None, None), vel_lab=wanted))
    aloft = start(everyone(here), START + np.array([0.0, 0.0, 0.5, 0.0]) * (np.arange(3) == 0)[:, None], 0)
    generator, path = fly(aloft, moving, 0.0, 3.0, lead)
    smooth(path)
    np.testing.assert_allclose(path[65][:, 1], [wanted] * 3, atol=1e-9)
    np.testing.assert_allclose(path[-1][:, 0] - path[100][:, 0], np.array([wanted] * 3) * 1.99, atol=1e-9)
    _, end = fly(generator, everyone(here), 3.0, 4.0, lead)
    smooth(path + end)
    np.testing.assert_allclose(end[-1][:, 1], 0.0, atol=1e-9)
