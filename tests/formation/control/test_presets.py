"""Gains follow a vehicle's lag as their dimensions say, and each reaches its own place."""

from dataclasses import replace

import numpy as np
import pytest

from formation.config import FollowerConfig, LabConfig, LeaderConfig, MocapConfig
from formation.control.gains import Law
from formation.control.presets import DEFAULT, PAPER_CFC, gain_scale_of, preset, preset_for, scaled_for
from formation.control.settings import attitude_settings, force_limits, law_settings, observer_settings
from formation.estimation.settings import ObserverGains
from formation.vehicle.profile import ARDUCOPTER_QUAD, PAPER_40G, PX4_QUAD, GainScale


def test_a_slower_observer_has_the_same_poles_in_its_own_time() -> None:
    """w, rad/s, alone goes with the gain_scale: alpha has no dimension, and the error's scale is the camera's."""
    gains = ObserverGains(12.0, -0.1, 0.004, 0.7)
    assert gains.scaled(0.5) == ObserverGains(6.0, -0.1, 0.004, 0.7)


def test_the_gain_scale_is_inverse_to_the_loops_delay() -> None:
    """By hand, 50 Hz and 20 ms. Horizontal: wait 0.02 + 1.5 / 50 = 0.05; PX4 0.05 + 0.21 + 0.065 = 0.325.

    Vertical: 0.03 over 0.02 + 0.08, the dead times of cameras and thrust.
    """
    cameras = MocapConfig(rate_hz=50.0, delay_s=0.02)
    late = PX4_QUAD.model_copy(update={"thrust_dead_time_s": 0.08})
    gain_scale = gain_scale_of(late, cameras)
    assert (gain_scale.horizontal, gain_scale.observer, gain_scale.vertical) == pytest.approx(
        (0.17 / 0.325, 0.17 / 0.325, 0.3)
    )
    assert gain_scale.compensation == 1.0
    assert gain_scale_of(PAPER_40G, MocapConfig()) == GainScale()


def test_the_papers_vehicle_is_what_the_gains_were_found_on() -> None:
    """Horizontal 0.008 + 0.015 + 2 x 0.049 + 0.049 = 0.170 s; vertical 0.008 + 0.052 = 0.060 s at half rate."""
    quicker = PAPER_40G.model_copy(update={"response_lag_s": 0.02, "thrust_lag_s": 0.01})
    assert gain_scale_of(quicker, MocapConfig()) == GainScale()
    slower = PAPER_40G.model_copy(update={"response_lag_s": 0.049 + 0.17, "thrust_dead_time_s": 0.052})
    gain_scale = gain_scale_of(slower, MocapConfig())
    assert (gain_scale.horizontal, gain_scale.vertical) == pytest.approx((0.5, 0.5))


def test_each_loop_goes_at_its_own_pace() -> None:
    gain_scale = GainScale(horizontal=0.5, observer=0.6, vertical=0.7, compensation=0.8)
    slow = scaled_for(DEFAULT, PX4_QUAD.model_copy(update={"gain_scale": gain_scale}), MocapConfig())
    assert slow.follower == DEFAULT.follower.scaled(0.5)
    assert slow.leader == DEFAULT.leader.scaled(0.5)
    assert slow.follower_vertical == DEFAULT.follower_vertical.scaled(0.7)
    assert slow.leader_vertical == DEFAULT.leader_vertical.scaled(0.7)
    assert slow.observer == DEFAULT.observer.scaled(0.6)
    assert slow.own_observer == DEFAULT.own_observer.scaled(0.6)
    assert slow.vertical_observer == DEFAULT.vertical_observer.scaled(0.7)
    assert (slow.dead_share, slow.lag_share) == pytest.approx((0.8 * DEFAULT.dead_share, 0.8 * DEFAULT.lag_share))
    assert slow.parallel.bandwidth_rad_s == pytest.approx(0.6 * DEFAULT.parallel.bandwidth_rad_s)
    assert slow.parallel.urgency == pytest.approx(1.0 + 0.6 * (DEFAULT.parallel.urgency - 1.0))
    assert slow.seen_observer == DEFAULT.seen_observer


def test_the_printed_gains_are_tables_2() -> None:
    """Table 2: SMC c = 1, k = 5; ISTSMC c = 1, p1 = 8, p2 = 0.1, eps = -0.49; FTESO w = 70, a = -2/9."""
    cfc, smc = PAPER_CFC.follower, preset("paper_smc").follower
    assert (cfc.c, cfc.p1, cfc.p2, cfc.eps, cfc.smooth_m_s) == (1.0, 8.0, 0.1, -0.49, 0.0)
    assert preset("paper_istsmc").follower == replace(cfc, law=Law.ISTSMC)
    assert (smc.law, smc.c, smc.k) == (Law.SMC, 1.0, 5.0)
    assert PAPER_CFC.observer == ObserverGains(70.0, -2.0 / 9.0, 1.0, 0.0)
    assert preset_for("paper", PX4_QUAD, MocapConfig()) == PAPER_CFC
    assert preset_for("default", PX4_QUAD, MocapConfig()).follower.c < DEFAULT.follower.c


CONFIG = LabConfig(
    leader=LeaderConfig(body="L"),
    followers=(FollowerConfig(body="A", sysid=2, offset_m=(-1.0, 0.0, 0.0)),
               FollowerConfig(body="B", sysid=3, offset_m=(-1.0, 1.0, 0.0))),
)  # fmt: skip
BODIES = (PAPER_40G, PX4_QUAD, ARDUCOPTER_QUAD)


def test_noise_and_the_slowest_followers_loop_reach_the_observers() -> None:
    """From camera to force: the cameras' delay, 1.5 frames of 10 ms, twice the dead time, and the lag."""
    gains = tuple(replace(DEFAULT, quiet_m=3e-4 * k) for k in (1, 2, 3))
    observers = observer_settings(CONFIG, BODIES, gains)
    np.testing.assert_allclose(observers["quiet_m"], [3e-4, 6e-4, 9e-4])
    loops_s = [b.response_lag_s + 2.0 * b.response_dead_time_s + 0.015 + CONFIG.mocap.delay_s for b in BODIES]
    np.testing.assert_allclose(observers["ahead_s"], [max(loops_s[1:])] * 3)


def test_bodies_and_limits_reach_the_law_and_the_attitude() -> None:
    attitude, laws = attitude_settings(CONFIG, BODIES), law_settings(CONFIG, (DEFAULT,) * 3)
    limits = force_limits(CONFIG, BODIES)
    assert limits["vehicle"].tolist() == laws["vehicle"].tolist() == [1, 2]
    for name, value in (("tilt_max_rad", 0.6), ("fence_margin_m", 0.05)):
        np.testing.assert_allclose(limits[name], [value] * 2)
    np.testing.assert_allclose(limits["fence_low_m"], [CONFIG.limits.fence.low_m] * 2)
    np.testing.assert_allclose(limits["fence_high_m"], [CONFIG.limits.fence.high_m] * 2)
    np.testing.assert_allclose(attitude["tilt_max_rad"], [0.6] * 2)
    np.testing.assert_allclose(attitude["yaw_p_1_s"], [2.8, 6.7])
    np.testing.assert_allclose(laws["speed_m_s"], [3.0] * 2)
