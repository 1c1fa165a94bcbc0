import pytest

from bench import steady_push
from bench.steady_push import Push, scenario_of
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PAPER_40G
from sim.research.host import Host


def test_the_push_is_a_share_of_what_the_tilt_limit_holds_against() -> None:
    """g tan(0.6 rad) = 6.705 m/s^2, from the side, alike 2 m away."""
    scenario = scenario_of(Push(0.5, 1.6))
    fan = scenario.air.fan
    assert fan is not None
    assert fan.peak_m_s2 == pytest.approx(0.5 * GRAVITY_M_S2 * 0.684137)
    assert fan.diameter_m > 2.0 * fan.pos_lab_m[0]
    assert scenario.true_vehicle(2).vehicle == {"motor_lag_s": pytest.approx(0.04)}
    assert scenario.lab.profile_of(scenario.lab.followers[0]) == PAPER_40G


NIGHTLY = [pytest.param(share, lag, marks=pytest.mark.nightly) for share, lag in ((0.6, 1.0), (0.6, 1.6), (0.9, 1.0))]


@pytest.mark.parametrize(("share", "motor_lag"), [*NIGHTLY, (0.9, 1.6)])
def test_a_hover_comes_to_rest_in_a_steady_push(share: float, motor_lag: float) -> None:
    """With motors 1.6 times as slow as believed as well, but later.

    At 0.9 of the limit a tenth of it, 0.67 m/s^2, is left to bring back the 0.1 m that it was pushed off: 0.5 s alone.
    """
    settling = steady_push.fly(Push(share, motor_lag, seed=7, host=Host.LOCKSTEP))
    assert settling.at_rest
    assert settling.settle_s < (1.25 if motor_lag == 1.0 else 3.0)
