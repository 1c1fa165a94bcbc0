import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from formation.config import FollowerConfig, LabConfig, LeaderConfig, TrajectoryConfig
from formation.control.limits.attitude import turn_authority
from formation.control.stack import ControlStack, Stages
from formation.guidance.plan import IDLE, Mode, Plan, Setpoint
from formation.guidance.shape import configured
from formation.maths import frames
from formation.maths.arrays import Float
from formation.messages import LabFrame
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile, at_rest, profile
from formation.warm_up import warm_up
from tests.formation.flight import OFFSETS, START_NS, Room, fly, hovering_at, rms, slot_errors, triangle

PAPER, PRINTED = profile("paper_40g"), profile("paper_40g_printed")
ALONE = frozenset({"separation-filter"})
IN_SLOTS = tuple(hovering_at(PAPER, (x, y, 0.3)) for x, y, _ in ((0.0, 0.0, 0.0), *OFFSETS))


def in_formation(config: LabConfig, start_s: float = 1.0) -> Plan:
    return Plan((Setpoint(Mode.FORMATION),) * 3, configured(config), START_NS + round(start_s * 1e9))


def test_line_is_flown_within_a_millimetre() -> None:
    config = triangle(path=TrajectoryConfig(kind="line", duration_s=5.0))
    samples = fly(config, lambda t: in_formation(config), IN_SLOTS, 7.0)
    settled = [s for s in samples if s.t_s > 1.0]
    assert rms(np.vstack([slot_errors(settled, k) for k in (0, 1)])) < 0.001
    assert samples[-1].truth[0].pos_lab_m[0] == pytest.approx(1.0, abs=0.02)


def test_slots_swing_with_a_yawing_leader() -> None:
    config = triangle(path=TrajectoryConfig(kind="hold", yaw_rate_rad_s=1.0, duration_s=8.0))
    samples = fly(config, lambda t: in_formation(config), IN_SLOTS, 8.0)
    settled = [s for s in samples if s.t_s > 1.0]
    assert rms(np.vstack([slot_errors(settled, k) for k in (0, 1)])) < 0.005
    assert frames.yaw(samples[400].truth[0].q_lab_from_flu) == pytest.approx(2.0, abs=0.1)


def test_a_px4_with_its_dead_time_is_held() -> None:
    config = triangle("px4_quad", TrajectoryConfig(kind="line", duration_s=5.0))
    body = profile("px4_quad")
    starts = tuple(hovering_at(body, (x, y, 0.3)) for x, y, _ in ((0.0, 0.0, 0.0), *OFFSETS))
    samples = fly(config, lambda t: in_formation(config), starts, 7.0)
    settled = [s for s in samples if s.t_s > 1.0]
    assert rms(np.vstack([slot_errors(settled, k) for k in (0, 1)])) < 0.01


@pytest.mark.parametrize("mass", [0.7, 1.3])
def test_takes_off_holds_and_lands_whatever_it_weighs(mass: float) -> None:
    config = triangle()
    grounded = tuple(at_rest(np.array([x, y, 0.0]), frames.IDENTITY) for x, y, _ in ((0.0, 0.0, 0.0), *OFFSETS))
    body = PAPER.model_copy(update={"mass_kg": mass * PAPER.mass_kg})

    def plan(t_s: float) -> Plan:
        setpoint = IDLE if t_s < 0.3 else Setpoint(Mode.LAB, (None, None, 0.3 if t_s < 5.0 else -0.3))
        return Plan((setpoint,) * 3, configured(config))

    samples = fly(config, plan, grounded, 9.0, truth=(body,) * 3)
    height = np.array([[s.pos_lab_m[2] for s in sample.truth] for sample in samples])
    t = np.array([sample.t_s for sample in samples])
    assert (height[t < 0.3] < 0.01).all()
    assert height.max() < 0.4
    np.testing.assert_allclose(height[(t > 4.5) & (t < 5.0)], 0.3, atol=0.02)
    assert (height[-1] < 0.01).all()
    assert samples[-1].stages.target.thrust_norm.max() < 0.95 * PAPER.hover_thrust_norm


def test_lands_where_the_fence_ends_at_the_floor() -> None:
    """Held up by it, a drone on the floor was sent what hovers it, and no touch-down was seen."""
    config = triangle()
    fence = config.limits.fence
    low = (*fence.low_m[:2], 0.0)
    limits = config.limits.model_copy(update={"fence": fence.model_copy(update={"low_m": low})})

    def plan(t_s: float) -> Plan:
        return Plan((Setpoint(Mode.LAB, (None, None, 0.3 if t_s < 0.5 else -0.3)),) * 3, configured(config))

    samples = fly(config.model_copy(update={"limits": limits}), plan, IN_SLOTS, 4.0)
    assert max(s.pos_lab_m[2] for s in samples[-1].truth) < 0.01
    assert samples[-1].stages.target.thrust_norm.max() < 0.95 * PAPER.hover_thrust_norm


def test_a_push_is_resisted_and_found_by_z3() -> None:
    config = triangle()
    setpoint = Plan((Setpoint(Mode.LAB, (None, None, None)),) * 3, configured(config))
    push = np.array([1.0, 0.0, 0.0])
    room = Room(push=lambda k, t: push if k == 1 and t > 1.0 else np.zeros(3))
    samples = fly(config, lambda t: setpoint, IN_SLOTS, 4.0, room)
    moved = np.array([s.truth[1].pos_lab_m[0] - samples[0].truth[1].pos_lab_m[0] for s in samples])
    assert np.abs(moved).max() < 0.06
    assert abs(moved[-1]) < 0.01
    assert samples[-1].stages.state.dist_lab_m_s2[1, 0] == pytest.approx(1.0, abs=0.1)


def test_a_gap_of_50_ms_in_the_frames_is_ridden_out() -> None:
    config = triangle(path=TrajectoryConfig(kind="line", duration_s=4.0))
    samples = fly(config, lambda t: in_formation(config), IN_SLOTS, 6.0, Room(gap=(2.5, 2.55)))
    errors = np.vstack([slot_errors(samples, k) for k in (0, 1)])
    assert np.abs(errors).max() < 0.01


@pytest.mark.parametrize("rate_hz", [50.0, 240.0])
def test_other_frame_rates_need_no_other_gains(rate_hz: float) -> None:
    config = triangle(path=TrajectoryConfig(kind="line", duration_s=4.0))
    samples = fly(config, lambda t: in_formation(config), IN_SLOTS, 6.0, Room(rate_hz=rate_hz))
    assert rms(np.vstack([slot_errors(samples, k) for k in (0, 1)])) < 0.005


def test_the_same_flight_twice_is_bit_identical() -> None:
    config = triangle(path=TrajectoryConfig(kind="circle"))
    one, two = (fly(config, lambda t: in_formation(config), IN_SLOTS, 2.0) for _ in range(2))
    assert all(a.stages.target.q_lab_from_flu.tobytes() == b.stages.target.q_lab_from_flu.tobytes()
               for a, b in zip(one, two, strict=True))  # fmt: skip


def test_nobody_leaves_the_fence() -> None:
    config = triangle()
    outside = Plan((Setpoint(Mode.LAB, (None, 3.0, None), None, 3.0),) * 3, configured(config))
    samples = fly(config, lambda t: outside, IN_SLOTS, 6.0)
    furthest = max(s.pos_lab_m[1] for sample in samples for s in sample.truth)
    assert 1.7 < furthest < 2.0


def many(offsets: list[tuple[float, float, float]]) -> LabConfig:
    followers = tuple(FollowerConfig(body=f"F{k}", sysid=2 + k, offset_m=o) for k, o in enumerate(offsets))
    return LabConfig(leader=LeaderConfig(body="L"), followers=followers)


def seen(config: LabConfig, k: int, pos: Float, q: Float) -> LabFrame:
    t_ns, names = START_NS + k * 10_000_000, tuple(v.body for v in config.vehicles)
    return LabFrame(k, t_ns, names, pos, q, np.ones(len(names), dtype=np.bool_))


def run(
    config: LabConfig, poses: list[tuple[Float, Float]], plan: Plan, vehicle: VehicleProfile = PAPER
) -> list[Stages]:
    stack = ControlStack(config, (vehicle,) * len(config.vehicles), without=ALONE)
    hover = np.full(len(config.commanded), PAPER.hover_thrust_norm)
    return [stack.step(START_NS + k * 10_000_000 + 8_000_000, seen(config, k, *pose), plan, hover)
            for k, pose in enumerate(poses)]  # fmt: skip


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_a_batch_is_the_same_as_one_at_a_time(seed: int) -> None:
    rng = np.random.default_rng(seed)
    offsets = [(-0.6, 0.6, 0.1), (-0.6, -0.6, 0.0), (0.7, 0.0, -0.1)]
    whole = many(offsets)
    place = np.array([[0.0, 0.0, 1.0], *((x, y, z + 1.0) for x, y, z in offsets)])
    poses = []
    for _ in range(25):
        place = place + 0.002 * rng.standard_normal((4, 3))
        poses.append((place, frames.from_rotation_vector(0.01 * rng.standard_normal((4, 3)))))
    plan = Plan((Setpoint(Mode.FORMATION),) * 3, configured(whole))
    together = run(whole, poses, plan)[-1].target
    for k, offset in enumerate(offsets):
        alone = many([offset])
        rows = [0, 1 + k]
        single = run(alone, [(p[rows], q[rows]) for p, q in poses], Plan(plan.setpoints[:1], configured(alone)))[
            -1
        ].target
        np.testing.assert_array_equal(single.q_lab_from_flu[0], together.q_lab_from_flu[k])
        np.testing.assert_array_equal(single.rate_flu_rad_s[0], together.rate_flu_rad_s[k])
        assert single.thrust_norm[0] == together.thrust_norm[k]


@pytest.mark.parametrize(
    ("preset", "least_m", "most_m"), [("paper_istsmc", 0.03, 0.07), ("paper", 0.03, 0.07), ("paper_smc", 0.08, 0.13)]
)
def test_the_printed_gains_swing_on_the_printed_vehicle(preset: str, least_m: float, most_m: float) -> None:
    """A numerical study of the law on Table 1 found 0.04-0.06 m on this much lag, and 0.085-0.11 m for SMC."""
    config = triangle(PRINTED.name, preset=preset)
    setpoint = Plan((Setpoint(Mode.LAB, (None, None, None)),) * 3, configured(config))
    samples = fly(config, lambda t: setpoint, IN_SLOTS, 8.0, without=ALONE)  # it would calm them
    swing_m = np.ptp([s.truth[1].pos_lab_m[:2] for s in samples if s.t_s > 4.0], axis=0) / 2.0
    assert ((least_m < swing_m) & (swing_m < most_m)).all()


def test_a_hard_turn_is_asked_of_the_attitude_itself_no_harder_than_the_motors_can() -> None:
    """A target far ahead, taken back by body rates, would be a hard turn to an autopilot quicker than is believed."""
    config = triangle(PRINTED.name)  # whose motors can hardly turn it
    level, place = np.tile(frames.IDENTITY, (3, 1)), np.array([s.pos_lab_m for s in IN_SLOTS])
    away = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [0.0, 0.0, 0.0]])  # 3 m/s, of one follower
    plan = Plan((Setpoint(Mode.LAB, (None, None, None)),) * 3, configured(config))
    stages = run(config, [(place, level), (place + away, level)], plan, PRINTED)[-1]
    gravity, full = GRAVITY_M_S2, PRINTED.thrust_max_n / PRINTED.mass_kg
    most_m_s2 = turn_authority(PRINTED) * gravity * min(gravity, full - gravity)
    tilt_rad = 2.0 * np.arcsin(np.hypot(*stages.target.q_lab_from_flu[1, 1:3]))
    assert stages.command.acc_lab_m_s2[1, 0] < -2.0 * most_m_s2
    assert tilt_rad == pytest.approx(np.arctan(most_m_s2 / gravity), rel=0.01)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_slot_is_joined_calmly_however_the_leader_is_seen(seed: int) -> None:
    """Noise of 40 mrad turned slots 1.3 m away at 10 m/s: joined from that motion, followers were led 14 m astray."""
    slots = (-1.2, 0.4, 0.0), (-1.2, -0.4, 0.0)
    config = LabConfig(
        leader=LeaderConfig(body="L"),
        followers=tuple(FollowerConfig(body=f"F{k}", sysid=2 + k, offset_m=slot) for k, slot in enumerate(slots)),
    )
    stack, shape, rng = ControlStack(config, (PAPER,) * 3), configured(config), np.random.default_rng(seed)
    pos, hover = np.vstack([np.zeros(3), shape.offsets]), np.full(2, PAPER.hover_thrust_norm)
    pos[:, 2] = 0.3
    for k in range(300):
        q = frames.from_rotation_vector(np.array([[0.04], [0.001], [0.001]]) * rng.standard_normal((3, 3)))
        t_ns = START_NS + k * 10_000_000
        frame = LabFrame(k, t_ns, ("L", "F0", "F1"), pos + 1e-4 * rng.standard_normal((3, 3)), q, np.ones(3, np.bool_))
        plan = Plan((Setpoint(Mode.LAB if k < 100 else Mode.FORMATION),) * 2, shape)
        reference = stack.step(t_ns + 10_000_000, frame, plan, hover).reference
        if k >= 100:
            assert np.linalg.norm(reference.slot_lead_m - shape.offsets, axis=-1).max() < 0.2


def test_an_unknown_preset_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"nonsense.*default.*paper"):
        ControlStack(triangle(preset="nonsense"), (PAPER,) * 3)


def test_warming_up_leaves_nothing_to_compile() -> None:
    warm_up(triangle(), (PAPER,) * 3)
    warm_up(many([(1.0, 0.0, 0.0)]), (PAPER,) * 2)


@pytest.mark.parametrize("commanded", [True, False])
def test_slots_turn_with_a_leader_that_wobbles_but_their_drones_as_its_plan_where_that_is_known(
    commanded: bool,
) -> None:
    """It swings by 10 mrad at 0.4 Hz; a yaw loop as slow as PX4's answers that with three times as much."""
    config = triangle()
    if not commanded:
        config = config.model_copy(update={"leader": LeaderConfig(body="leader")})
    bodies = config.vehicles[not commanded :]
    plan = Plan((Setpoint(Mode.FORMATION),) * len(bodies), configured(config))
    stack, hover = ControlStack(config, (PAPER,) * 3), np.full(len(bodies), PAPER.hover_thrust_norm)
    pos = np.array([(0.0, 0.0, 0.3), *((x, y, 0.3) for x, y, _ in OFFSETS)])
    slots_rad, asked_rad = [], []
    for i in range(500):
        q = np.array([frames.from_yaw(0.01 * np.sin(0.8 * np.pi * i * 0.01)), frames.IDENTITY, frames.IDENTITY])
        t_ns = START_NS + i * 10_000_000
        frame = LabFrame(i, t_ns, tuple(v.body for v in config.vehicles), pos, q, np.ones(3, np.bool_))
        stages = stack.step(t_ns + 5_000_000, frame, plan, hover)
        slots_rad.append(stages.reference.heading_rad[-1])
        asked_rad.append(stages.command.yaw_rad[-1])
    assert np.std(slots_rad[250:]) > 0.005
    assert np.std(asked_rad[250:]) == 0.0 if commanded else np.std(asked_rad[250:]) > 0.005
