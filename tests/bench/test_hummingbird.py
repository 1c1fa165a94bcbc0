"""Somebody else's vehicle behind our setpoints; the oracle is rotorpy itself, and hand computation."""

import numpy as np
import pytest

pytest.importorskip("rotorpy", reason="rotorpy is not installed: pip install 'mavlink-formation[rotorpy]'")

from bench.hummingbird import flights
from bench.hummingbird.vehicle import HUMMINGBIRD, STEP_NS, RotorpyVehicle, push_m_s2, rotorpy_physics, wind_m_s
from drone_agent.guard.position import LoopSetpoint
from formation.maths.frames import from_rotation_vector
from formation.messages import Phase
from formation.vehicle.profile import VehicleState, at_rest
from sim.research.experiments import Experiment
from sim.world import T0_NS, World

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
STILL = np.zeros(3)
S = 1_000_000_000
HOVER_N = 0.25 * HUMMINGBIRD.weight_n


def flown(
    state: VehicleState, attitude: np.ndarray, seconds: float, *, thrust: float = 1.0, push: np.ndarray = STILL
) -> VehicleState:
    """Under one attitude and `thrust` times the weight."""
    norm = HUMMINGBIRD.thrust_norm_of(thrust * HUMMINGBIRD.weight_n)
    steps = round(seconds * 1e9 / STEP_NS)
    asked = LoopSetpoint(attitude, STILL, norm)
    return RotorpyVehicle().advance(state, HUMMINGBIRD, asked, True, push, STEP_NS * 1e-9, steps)


def hovering() -> VehicleState:
    return at_rest(np.array([0.0, 0.0, 1.0]), LEVEL, HOVER_N)


def test_with_its_weight_in_thrust_it_hovers() -> None:
    """No ground effect, no drag at rest; its g is 9.81, and its integrator's tolerance 1e-3."""
    state = flown(hovering(), LEVEL, 0.2)
    assert state.pos_lab_m == pytest.approx([0.0, 0.0, 1.0], abs=5e-4)
    assert state.motor_thrust_n == pytest.approx([HOVER_N] * 4, rel=1e-3)


@pytest.mark.parametrize(
    ("turn", "more", "axis", "sign"),
    [
        ((0.1, 0.0, 0.0), (1, 2), 1, -1),  # roll to the right, about x: the left motors, and off to the right
        ((0.0, 0.1, 0.0), (1, 3), 0, 1),  # pitch, nose down, about y: the rear motors, and off forward
    ],
)
def test_its_motors_stand_where_ours_do(turn: tuple[float, ...], more: tuple[int, int], axis: int, sign: int) -> None:
    """Front right, rear left, front left, rear right."""
    attitude = from_rotation_vector(np.array(turn))
    begun = flown(hovering(), attitude, 0.008)
    less = [k for k in range(4) if k not in more]
    assert begun.motor_thrust_n[list(more)].min() > 1.1 * begun.motor_thrust_n[less].max()
    later = flown(begun, attitude, 0.4)
    assert later.q_lab_from_flu == pytest.approx(attitude, abs=2e-3)
    assert sign * later.vel_lab_m_s[axis] > 0.2


def test_wind_pushes_a_hovering_one_as_hard_as_the_fan_says() -> None:
    """Its parasitic drag, c_D v^2 = 0.005 N at 1 m/s, and translational lift come on top of the rotors' drag."""
    push = np.array([push_m_s2(1.0), 0.0, 0.0])
    assert wind_m_s(push) == pytest.approx([1.0, 0.0, 0.0])
    state = flown(hovering(), LEVEL, 0.012, push=push)
    assert state.vel_lab_m_s[0] / 0.012 == pytest.approx(push[0] + 0.005 / 0.5, rel=0.02)


def test_the_whole_stack_takes_it_to_its_slot() -> None:
    """Beside the pole, at rest: within what noise of 0.1 mm makes of a hover."""
    world = World(flights.scenario_for(Experiment.GUST), 1, lambda *_: None, physics=rotorpy_physics())
    while world.phase is not Phase.FORMATION and world.now_ns < T0_NS + 20 * S:
        world.step()
    reached_ns = world.now_ns
    while world.now_ns < reached_ns + 1.5 * S:
        world.step()
    truth = world.truths()[2]
    assert np.linalg.norm(truth.pos_lab_m - np.array([0.0, 0.0, 0.3])) < 0.005
    assert np.linalg.norm(truth.vel_lab_m_s) < 0.02
