"""The navigator on the recorded streams of a lockstep flight, with its landing; and a drift put into its poses."""

import pytest

from tests.drone_agent.guard.recorded import Recorded, flown, run


@pytest.fixture(scope="module")
def flight() -> Recorded:
    return flown("hover_gust")[2]


def length_s(flight: Recorded) -> float:
    return (flight.poses[-1][1] - flight.poses[0][1]) * 1e-9


def test_nothing_is_found_in_a_flight_in_which_nothing_is_wrong(flight: Recorded) -> None:
    result = run(flight, 0.0, length_s(flight))
    assert result.names == ()


@pytest.mark.parametrize("share", [0.4, 0.5, 0.6])
def test_a_drift_of_8_cm_s_is_found(flight: Recorded, share: float) -> None:
    result = run(flight, 0.08, share * length_s(flight))
    assert 0.0 <= result.found_s < 0.1
    assert result.pos_rms_m < 0.003
    assert result.vel_rms_m_s < 0.02
    assert result.pos_after_m < 0.03
