"""What is sent when: thrust against tilt, the history's stamps, and the lag's inversion on a simulated plant.

The plants are the oracles' own: dead time, first-order lag, a point mass. All axes and the heading move by numbers of
their own.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from formation.config import Fence, FollowerConfig, LabConfig, LeaderConfig, LimitsConfig, TrajectoryConfig
from formation.control.gains import LagCompensation
from formation.control.presets import DEFAULT, Preset
from formation.control.stack import ControlStack
from formation.guidance.plan import Mode, Plan, Setpoint
from formation.guidance.shape import configured
from formation.messages import LabFrame
from formation.vehicle.profile import PAPER_40G, PX4_QUAD, VehicleProfile
from tests.formation.oracles.frames import G, rot_z
from tests.formation.oracles.plant import Plant
from tests.formation.oracles.response import answered, step, system
from tests.formation.rig import Look, flown

T0, PERIOD_NS, DELAY_NS = 10**11, 10_000_000, 8_000_000
START, SLOT = np.array([0.0, 0.0, 1.0]), np.array([-0.6, 0.45, 0.3])
CONFIG = LabConfig(
    leader=LeaderConfig(body="L"), followers=(FollowerConfig(body="A", sysid=2, offset_m=tuple(SLOT)),)
)  # fmt: skip
PLAN = Plan((Setpoint(Mode.FORMATION),), configured(CONFIG))


def test_the_plants_exact_step_is_the_exponential_of_its_state_space() -> None:
    for h, lag in ((0.01, 0.05), (0.2, 0.05), (0.003, 0.11)):
        np.testing.assert_allclose(step(h, lag), expm(system(lag) * h), atol=1e-14)


PATH = TrajectoryConfig(
    kind="waypoints", waypoints_m=((0.9, 0.3, 1.3), (0.2, 0.9, 0.8), (0.0, 0.0, 1.0)), speed_m_s=0.9, yaw_rate_rad_s=0.6
)  # fmt: skip


def followed(body: VehicleProfile, gains: Preset, seconds: float = 4.0) -> np.ndarray:
    """Errors (frames, 4) of a follower in its leader's frame and of its heading; both answer exactly as believed."""
    config = LabConfig(
        leader=LeaderConfig(body="L", sysid=1, trajectory=PATH), followers=CONFIG.followers,
        limits=LimitsConfig(fence=Fence(low_m=(-9.0, -9.0, -9.0), high_m=(9.0, 9.0, 9.0))),
    )  # fmt: skip
    plan = Plan((Setpoint(Mode.FORMATION),) * 2, configured(config), T0)
    stack, hover = ControlStack(config, (body, body), gains), np.full(2, body.hover_thrust_norm)
    plants, errors = [Plant(body, T0, START), Plant(body, T0, START + SLOT)], []
    for k in range(round(seconds * 1e9 / PERIOD_NS)):
        t_ns, (lead, mine) = T0 + k * PERIOD_NS, plants
        errors.append([*(rot_z(lead.yaw).T @ (mine.pos - lead.pos) - SLOT), mine.yaw - lead.yaw])
        pos, q = np.array([p.pos for p in plants]), np.array([p.q for p in plants])
        frame = LabFrame(k, t_ns, ("L", "A"), pos, q, np.ones(2, dtype=np.bool_))
        target = stack.step(t_ns + DELAY_NS, frame, plan, hover).target
        for i, plant in enumerate(plants):
            plant.send(
                t_ns + DELAY_NS, target.q_lab_from_flu[i], target.rate_flu_rad_s[i], float(target.thrust_norm[i])
            )
            plant.advance(t_ns, t_ns + PERIOD_NS)
    return np.array(errors)


EXACT = replace(
    DEFAULT,
    dead_share=1.0,
    lag_share=1.0,
    lag_compensation=LagCompensation(),
    leader_lag_compensation=LagCompensation(),
)


@pytest.mark.parametrize(
    ("body", "most"),
    [(PAPER_40G, (0.006, 0.0075, 0.001, 0.018)), (PX4_QUAD, (0.009, 0.010, 0.0025, 0.020))],
    ids=("paper_40g", "px4_quad"),
)
def test_a_plant_of_dead_time_and_lag_is_flown_in_x_y_z_and_yaw_with_its_lag_inverted(
    body: VehicleProfile, most: tuple[float, float, float, float]
) -> None:
    """Lag compensation: sent ahead by the lag times the demand's rate, the felt force is the demand itself.

    With a third of the lag or of the dead time counted on, errors are 1.5 to 3 times these.
    """
    worst = np.abs(followed(body, EXACT)).max(axis=0)
    assert (worst < most).all(), worst


PLACE = np.array([START, START + SLOT])
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("delay_ns", [1_000_000, 7_000_000])
def test_the_history_of_commands_is_stamped_when_they_are_sent_not_at_the_frames_capture(delay_ns: int) -> None:
    """What is modelled to be felt is the plant's answer to thrusts counted from the time of the tick."""
    quick = PAPER_40G.model_copy(update={"thrust_dead_time_s": 0.006, "drag_n_s_m": (0.0, 0.0, 0.0)})
    looks = [
        Look(T0 + k * PERIOD_NS + delay_ns, T0 + k * PERIOD_NS, PLACE + np.array([0.0, 0.0, 0.03 * (k % 2)]),
             np.tile(LEVEL, (2, 1)), np.ones(2, dtype=np.bool_)) for k in range(6)
    ]  # fmt: skip
    gains = replace(DEFAULT, thrust_scale_lag_s=1e12)
    stages = flown(CONFIG, (quick, quick), gains, PLAN, looks, np.array([quick.hover_thrust_norm]))
    lift = [G, *(quick.thrust_n_of(float(s.target.thrust_norm[0])) / quick.mass_kg for s in stages)]
    times = np.array([T0 - 10**9, *(look.now_ns for look in looks)])
    felt = np.array([G])
    for k in range(1, 6):
        span = (T0 + (k - 1) * PERIOD_NS, T0 + k * PERIOD_NS)
        felt, _, _ = answered(times[: k + 1], np.array(lift)[: k + 1, None], *span, 0.006, quick.thrust_lag_s, felt)
        modelled = stages[k].state.acc_lab_m_s2[1, 2] - stages[k].state.dist_lab_m_s2[1, 2]
        assert modelled == pytest.approx(felt[0] - G, abs=1e-9)
    assert np.ptp(lift) > 0.5


def test_a_tilted_vehicle_gets_the_thrust_that_lifts_its_weight() -> None:
    """Tilt compensation: thrust = vertical force over the cosine of the tilt that it has when the thrust arrives."""
    lean = 0.35
    q = np.array([LEVEL, [np.cos(0.5 * lean), np.sin(0.5 * lean), 0.0, 0.0]])
    looks = [
        Look(T0 + k * PERIOD_NS + 1, T0 + k * PERIOD_NS, PLACE, q if k else np.tile(LEVEL, (2, 1)),
             np.ones(2, dtype=np.bool_)) for k in range(2)
    ]  # fmt: skip
    slow = PAPER_40G.model_copy(update={"response_dead_time_s": 0.2, "thrust_dead_time_s": 0.0})
    gains = replace(DEFAULT, attitude_trust=1.0, lag_compensation=LagCompensation(rate=0.0), thrust_scale_lag_s=1e12)
    stages = flown(CONFIG, (slow, slow), gains, PLAN, looks, np.array([slow.hover_thrust_norm]))[-1]
    lift = slow.thrust_n_of(float(stages.target.thrust_norm[0])) / slow.mass_kg
    assert lift == pytest.approx((G + stages.command.acc_lab_m_s2[0, 2]) / np.cos(lean), rel=0.005)  # a trim is begun
