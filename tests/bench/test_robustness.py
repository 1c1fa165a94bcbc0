import pytest

from bench import robustness
from bench.robustness import Draw
from sim.research import host, push
from sim.research.host import Host


@pytest.mark.parametrize("seed", [68, *(pytest.param(seed, marks=pytest.mark.nightly) for seed in (62, 95))])
def test_a_drawn_vehicle_is_not_held_for_a_fault_that_its_poses_do_not_have(seed: int) -> None:
    """62 is turned by a gust while only ATTITUDE_QUATERNION shows it, beside poses with 10 mrad of noise.

    68 rises before a delay of noisy poses can be told; 95 is turned by a gust as fast as 10 rad/s.
    """
    assert not robustness.fly(Draw(seed, host=Host.LOCKSTEP)).failed


@pytest.mark.parametrize("share", [0.35, 0.45, 0.55])
def test_a_vehicle_quicker_than_believed_does_not_swing_on_in_a_push(share: float) -> None:
    """Of 1.2 times the mass, with loops 1.8 times as fast, seen at 50 Hz with 0.4 mm of noise; shares of the limit.

    From 0.6 on it may: turning takes so much of the motors that the height goes.
    """
    scenario = robustness.scenario_of(Draw(67, "px4_quad"))
    scenario = scenario.model_copy(update=push.push_of(scenario.lab, share))
    result, flight = host.fly(scenario, 67, host=Host.LOCKSTEP)
    assert push.settling(flight, result).swing_deg < 0.6 * robustness.SWING_DEG
