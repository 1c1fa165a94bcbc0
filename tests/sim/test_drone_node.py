"""What the truth of a simulated drone says of its motors."""

import numpy as np
import pytest

from sim.drone_node import level_share


@pytest.mark.parametrize(
    ("motor_gain", "share"),
    [
        ((1.0, 1.0, 1.0, 1.0), 1.0),
        ((0.6, 0.6, 0.6, 0.6), 0.6),
        ((1.0, 0.0, 1.0, 1.0), 0.5),
        ((0.1, 1.0, 1.0, 0.9), 0.5),
    ],
)
def test_a_weak_motor_holds_back_the_opposite_one(motor_gain: tuple[float, ...], share: float) -> None:
    """Front right, rear left, front left, rear right: of a pair, the lesser counts twice, else it tilts."""
    assert level_share(np.array(motor_gain)) == pytest.approx(share)
