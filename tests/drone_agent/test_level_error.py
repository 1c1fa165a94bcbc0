"""An autopilot whose idea of level wanders: how far, how slowly, and what it makes of a level target."""

import numpy as np
import pytest

from drone_agent.simulation.level_error import AttitudeBias, LevelError
from formation.maths.arrays import Float
from formation.maths.frames import rotate
from tests.drone_agent.agent_harness import LEVEL, Harness, S, hover_at, tilt_rad
from wire.link_messages.motion import AttitudeQuaternion


def _leans(error: LevelError, seconds: float, every_s: float) -> Float:
    """Along lab x and y, rad, after each `every_s`."""
    bias = AttitudeBias(error, 1, 0)
    up = np.array([0.0, 0.0, 1.0])
    rows = []
    for k in range(round(seconds / every_s)):
        bias.advance_to(round(k * every_s * S))
        rows.append(rotate(bias.estimated(LEVEL), up)[:2])
    return np.array(rows)


def test_wanders_as_far_and_as_slowly_as_asked() -> None:
    leans = _leans(LevelError(rms_rad=0.01, correlation_s=2.0), 2000.0, every_s=0.2)
    assert leans.std(axis=0) == pytest.approx([0.01, 0.01], rel=0.12)
    apart = round(2.0 / 0.2)
    for axis in range(2):
        kept = float(np.corrcoef(leans[apart:, axis], leans[:-apart, axis])[0, 1])
        assert kept == pytest.approx(np.exp(-1.0), abs=0.1)


def test_what_it_flies_it_believes_to_be_what_was_asked() -> None:
    bias = AttitudeBias(LevelError(rms_rad=0.02), 3, 0)
    bias.advance_to(5 * S)
    np.testing.assert_allclose(bias.estimated(bias.true(LEVEL)), LEVEL, atol=1e-12)


def test_a_level_target_leans_the_vehicle_while_it_says_that_it_is_level() -> None:
    harness = Harness(
        profile="px4_quad", stale_setpoint_s=0.0, level_error=LevelError(rms_rad=0.02, correlation_s=100.0)
    )
    harness.fly_offboard(stream=hover_at(1.0))
    leaned_rad = tilt_rad(harness.truth.q_lab_from_flu)
    assert 0.002 < leaned_rad < 0.08
    assert tilt_rad(harness.last(AttitudeQuaternion).q_lab_from_flu) < 0.2 * leaned_rad
