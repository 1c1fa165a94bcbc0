"""The whole stack against Eqs. (2)-(7) written again in plain NumPy: every message of every tick, on random motions.

Leaders turn and accelerate; x, y, z and yaw move by numbers of their own, frames come unevenly and some are missed.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from formation.config import Fence, FollowerConfig, LabConfig, LeaderConfig, LimitsConfig, TrajectoryConfig
from formation.control.gains import GeometricGains
from formation.control.presets import DEFAULT, GEOMETRIC, PAPER_CFC, PAPER_ISTSMC, PAPER_SMC, PID, Preset
from formation.guidance.plan import IDLE as ON_FLOOR
from formation.guidance.plan import Mode, Plan, Setpoint
from formation.guidance.shape import configured
from formation.maths import frames
from formation.vehicle.profile import ARDUCOPTER_QUAD, PAPER_40G, PX4_QUAD, VehicleProfile
from tests.formation.oracles.estimator import age_s
from tests.formation.oracles.frames import rotation_matrix
from tests.formation.oracles.stack import CIRCLE, IDLE, POINT, SLOT, Circle, Task
from tests.formation.rig import Look, flown, foretold, oracle

T0 = 50 * 10**9
SLOTS = ((-0.9, 0.7, 0.2), (-0.6, -0.8, -0.1))
ROOM = LimitsConfig(fence=Fence(low_m=(-6.0, -5.0, -0.2), high_m=(5.0, 7.0, 4.0)), tilt_rad=0.55, min_separation_m=0.25)
PLACES = np.array([[0.35, 0.1, 1.2], [-0.7, 0.65, 1.45], [-0.2, -0.75, 1.0]])


def lab(sysid: int | None, limits: LimitsConfig = ROOM) -> LabConfig:
    return LabConfig(
        leader=LeaderConfig(body="L", sysid=sysid, trajectory=TrajectoryConfig(
            kind="circle", radius_m=0.4, period_s=5.0, laps=2, yaw_rate_rad_s=0.7)),
        followers=(
            FollowerConfig(body="A", sysid=2, offset_m=SLOTS[0], yaw_offset_rad=0.3),
            FollowerConfig(body="B", sysid=3, offset_m=SLOTS[1], yaw_offset_rad=-0.2),
        ),
        limits=limits,
    )  # fmt: skip


def looks(
    seed: int, ticks: int = 13, missed: bool = True, size: float = 1.0, places: np.ndarray = PLACES
) -> list[Look]:
    """Three bodies that swing along all axes, tilt and turn; stamps uneven, one in ten frames without one body."""
    rng = np.random.default_rng(seed)
    amplitude = size * rng.uniform(0.5, 1.0, (3, 3)) * [0.11, 0.07, 0.05]
    rate, phase = rng.uniform(2.0, 6.0, (3, 3)), rng.uniform(0.0, 6.0, (3, 3))
    yaw0, spin = rng.uniform(-3.0, 3.0, 3), rng.uniform(-1.5, 1.5, 3)
    out, t = [], T0
    for k in range(ticks):
        s = (t - T0) * 1e-9
        pos = places + amplitude * (np.sin(rate * s + phase) - np.sin(phase)) + 2e-4 * rng.standard_normal((3, 3))
        tilt = 0.15 * size * np.sin(rate[:, :2] * s + 1.0)
        turn = np.column_stack([np.zeros((3, 2)), yaw0 + spin * s + 0.2 * np.sin(3.0 * s)])
        lean = np.column_stack([tilt, np.zeros(3)]) + 1e-3 * rng.standard_normal((3, 3))
        q = frames.multiply(frames.from_rotation_vector(turn), frames.from_rotation_vector(lean))
        seen = np.ones(3, dtype=np.bool_)
        if missed and k > 5 and rng.uniform() < 0.3:
            seen[rng.integers(3)] = False
        out.append(Look(t + int(rng.integers(6_000_000, 12_000_000)), t, pos, q, seen))
        t += int(rng.integers(7_000_000, 14_000_000))
    return out


def felt(tick: int) -> np.ndarray:
    """What three accelerometers feel: gravity, noise, pushes that come and go, and nothing now and then."""
    rng = np.random.default_rng([11, tick])
    force = np.array([0.0, 0.0, 9.8]) + 0.3 * rng.standard_normal((3, 3))
    force[1:] += np.array([[2.5, -1.5, 0.2], [0.0, 4.0, 0.5]]) * [[8 < tick < 20], [tick > 25]]
    force[rng.uniform(size=3) < 0.1] = np.nan
    return force


def same(stages: list, told: list, atol: float = 1e-6) -> None:
    """Every number of every message."""
    for k, (one, other) in enumerate(zip(stages, told, strict=True)):
        pairs = {
            "Z1": (one.state.pos_lab_m, [e.pos for e in other.known]),
            "Z2": (one.state.vel_lab_m_s, [e.vel for e in other.known]),
            "Z3": (one.state.dist_lab_m_s2, [e.dist for e in other.known]),
            "acceleration": (one.state.acc_lab_m_s2, other.accelerations),
            "yaw": (one.state.yaw_rad, [e.heading[0] for e in other.known]),
            "yaw rate": (one.state.yaw_rate_rad_s, [e.heading[1] for e in other.known]),
            "yaw acceleration": (one.state.yaw_acc_rad_s2, other.turning),
            "age": (one.state.age_s, [age_s(e) for e in other.known]),
            "mismatch": (one.state.model_mismatch, [e.mismatch for e in other.known]),
            "slot": (one.reference.slot_lead_m, [slot[0, :3] for slot, _ in other.references]),
            "slot velocity": (one.reference.slot_vel_lead_m_s, [slot[1, :3] for slot, _ in other.references]),
            "slot acceleration": (one.reference.slot_acc_lead_m_s2, [slot[2, :3] for slot, _ in other.references]),
            "slot yaw": (one.reference.slot_yaw_rad, [slot[0, 3] for slot, _ in other.references]),
            "slot yaw rate": (one.reference.slot_yaw_rate_rad_s, [slot[1, 3] for slot, _ in other.references]),
            "origin": (one.reference.origin_lab_m, [frame[0, :3] for _, frame in other.references]),
            "origin velocity": (one.reference.origin_vel_lab_m_s, [frame[1, :3] for _, frame in other.references]),
            "origin acc": (one.reference.origin_acc_lab_m_s2, [frame[2, :3] for _, frame in other.references]),
            "heading": (one.reference.heading_rad, [frame[0, 3] for _, frame in other.references]),
            "heading rate": (one.reference.heading_rate_rad_s, [frame[1, 3] for _, frame in other.references]),
            "heading acc": (one.reference.heading_acc_rad_s2, [frame[2, 3] for _, frame in other.references]),
            "e, Eq. 2": (one.command.e_lead_m, [d.e for d in other.demands]),
            "e', Eq. 2": (one.command.e_rate_lead_m_s, [d.e_rate for d in other.demands]),
            "s, Eq. 5": (one.command.s_lead_m_s, [d.s for d in other.demands]),
            "t_m, Eq. 6": (one.command.t_m_lead_m_s2, [d.t_m for d in other.demands]),
            "z_m, Eq. 6": (one.command.z_m_lead_m_s2, [d.memory for d in other.demands]),
            "u, Eq. 7": (one.command.acc_lab_m_s2, [d.acc for d in other.demands]),
            "commanded yaw": (one.command.yaw_rad, [d.yaw for d in other.demands]),
            "commanded yaw rate": (one.command.yaw_rate_rad_s, [d.yaw_rate for d in other.demands]),
            "attitude": ([rotation_matrix(q) for q in one.target.q_lab_from_flu], [t.r for t in other.targets]),
            "body rates": (one.target.rate_flu_rad_s, [t.rate for t in other.targets]),
            "thrust": (one.target.thrust_norm, [t.thrust_norm for t in other.targets]),
            "limits met": (one.target.saturation, [t.bits for t in other.targets]),
        }
        for name, (mine, theirs) in pairs.items():
            np.testing.assert_allclose(mine, np.array(theirs), rtol=atol, atol=atol, err_msg=f"tick {k}: {name}")
        assert (one.target.q_lab_from_flu[:, 0] >= 0.0).all()


@dataclass(frozen=True)
class Case:
    """Who flies what, how."""

    bodies: tuple[VehicleProfile, ...]
    gains: Preset
    tasks: tuple[Task, ...]
    sysid: int | None = 1
    limits: LimitsConfig = ROOM
    size: float = 1.0
    places: tuple[tuple[float, float, float], ...] = ()
    ticks: int = 13
    unseen_until: int = 0  # the last body
    feels: bool = False


def joined(k: int, speed: float = 0.6) -> Task:
    return Task(SLOT, (*SLOTS[k], (0.3, -0.2)[k]), speed)


LEADING = (Task(CIRCLE, speed=0.6), joined(0), joined(1))
BEHIND_SEEN = (joined(0), joined(1))
POINTS = (
    Task(POINT, (0.8, None, 1.6, 0.4), 0.3),
    Task(POINT, (None, -0.3, None, None), 0.8),
    Task(POINT, (9.0, -9.0, 9.0, 2.5), 0.9),
)
STOUT = PAPER_40G.model_copy(
    update={"attitude_p_1_s": 9.0, "inertia_kg_m2": (9e-5, 1.2e-4, 2e-4), "rate_max_rad_s": 2.0}
)
LIVELY = replace(
    DEFAULT,
    observer=replace(DEFAULT.observer, alpha=-0.2, smooth=0.5),
    own_observer=replace(DEFAULT.own_observer, bandwidth_rad_s=14.0),
    leader=replace(DEFAULT.leader, c=3.0, p1=4.0),
    leader_vertical=replace(DEFAULT.leader_vertical, c=6.0, p2=2.0),
    leader_lag_compensation=replace(DEFAULT.leader_lag_compensation, rate=0.9, gain=1.3, gain_power=0.4, p1_power=0.2),
    thrust_scale_lag_s=0.3,
)
SLOW_PID = replace(
    PID, follower=replace(PID.follower, kd=0.15), follower_vertical=GeometricGains(8.0, 4.0, 3.0, 1.2, 0.01)
)
TIGHT = LimitsConfig(
    fence=Fence(low_m=(-0.75, -0.6, 0.9), high_m=(0.5, 0.75, 1.3)), tilt_rad=0.3, min_separation_m=0.9, speed_m_s=0.2
)
NEAR = ((0.0, 0.0, 1.0), (0.02, -0.01, 1.3), (0.3, -0.4, 1.1))
CASES = {
    "paper's vehicles behind a leader on a circle": Case((PAPER_40G, STOUT, PAPER_40G), LIVELY, LEADING),
    "PX4s behind a leader that is only seen": Case((PX4_QUAD,) * 3, LIVELY, BEHIND_SEEN, None),
    "ArduCopters to points": Case((ARDUCOPTER_QUAD, PX4_QUAD, STOUT), DEFAULT, POINTS),
    "from the floor, beside one idle": Case(
        (PAPER_40G,) * 3, DEFAULT, (Task(POINT), Task(IDLE), Task(POINT, (None, 0.2, None, None)))
    ),
    "printed CFC": Case((PAPER_40G,) * 3, PAPER_CFC, LEADING),
    "printed ISTSMC": Case((PX4_QUAD, PAPER_40G, STOUT), PAPER_ISTSMC, BEHIND_SEEN, None),
    "printed SMC": Case((PAPER_40G,) * 3, replace(PAPER_SMC, compensate=True), LEADING),
    "PID": Case((PAPER_40G, PX4_QUAD, PAPER_40G), SLOW_PID, LEADING),
    "geometric": Case((PAPER_40G, PX4_QUAD, ARDUCOPTER_QUAD), GEOMETRIC, LEADING),
    "beside a wall, near each other, fast": Case((STOUT, PX4_QUAD, PAPER_40G), LIVELY, POINTS, 1, TIGHT, 8.0),
    "one comes late": Case(
        (PX4_QUAD, PAPER_40G, STOUT), DEFAULT, (*BEHIND_SEEN[:1], Task(POINT)), None, unseen_until=4
    ),
    "with accelerometers": Case((PAPER_40G, STOUT, PX4_QUAD), LIVELY, LEADING, ticks=40, feels=True),
    "behind one seen, with accelerometers": Case((PX4_QUAD,) * 3, DEFAULT, BEHIND_SEEN, None, ticks=40, feels=True),
    "stacked": Case((PX4_QUAD, PAPER_40G, STOUT), DEFAULT, POINTS, 1, TIGHT, 3.0, NEAR),
}


@pytest.mark.parametrize("name", CASES)
def test_every_message_is_as_eqs_2_to_7_foretell(name: str) -> None:
    """Eqs. (2)-(7), lag compensation, limits, attitude, thrust and body rates, as a whole."""
    case = CASES[name]
    config = lab(case.sysid, case.limits)
    seen = looks(7, case.ticks, size=case.size, places=np.array(case.places or PLACES))
    for k in range(case.unseen_until):
        seen[k] = replace(seen[k], seen=np.array([True, True, False]))
    seen = [replace(look, felt=felt(k)) for k, look in enumerate(seen)] if case.feels else seen
    start_ns = seen[0].t_ns + 40_000_000
    hover = np.array([1.1, 0.9, 1.2])[-len(case.tasks) :] * [case.bodies[i].hover_thrust_norm for i in config.commanded]
    plan = Plan(tuple(_setpoint(task) for task in case.tasks), configured(config), start_ns)
    stack = oracle(config, case.bodies, case.gains, list(case.tasks), Circle(0.4, 5.0, 2, 0.7, start_ns))
    same(flown(config, case.bodies, case.gains, plan, seen, hover), foretold(stack, seen, hover))


def _setpoint(task: Task) -> Setpoint:
    x, y, z, yaw = task.goal
    if task.kind == IDLE:
        return ON_FLOOR
    return (
        Setpoint(Mode.LAB, (x, y, z), yaw, task.speed)
        if task.kind == POINT
        else Setpoint(Mode.FORMATION, speed_m_s=task.speed)
    )
