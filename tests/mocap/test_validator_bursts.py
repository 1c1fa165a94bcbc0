"""Poses stamped as they arrive: bursts and gaps of a network that holds frames back, or loses them, reject nobody."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from formation.maths import frames
from formation.messages import LabFrame
from formation.rejection import Rejection
from mocap.validator.judge import RECOVERY_FRAMES
from mocap.validator.validator import PoseValidator
from tests.mocap.validator_rig import BODIES, POSITIONS_LAB_M, T0_NS, UPRIGHT, lab

PERIOD_S, RADIUS_M = 0.01, 1.0
IN_BURST_S = 0.0004


def arrivals(seed: int, held_s: tuple[float, ...], is_lost: bool) -> Iterator[tuple[float, float]]:
    """Exposure and arrival of each frame that comes, s; every 1.2 s nothing arrives for one of `held_s`."""
    rng = np.random.default_rng(seed)
    free_s, start_s = 0.0, 1.0
    for k in range(100 + 120 * len(held_s)):
        exposed_s = k * PERIOD_S
        nth = int((exposed_s - start_s) // 1.2)
        end_s = start_s + 1.2 * nth + held_s[nth] if nth >= 0 else 0.0
        if is_lost and exposed_s < end_s:
            continue
        free_s = max(exposed_s + 0.004 + rng.exponential(0.001), end_s, free_s + IN_BURST_S)
        yield exposed_s, free_s


class Judge:
    """A walking leader and two hovering drones with their motors on, through the validator alone."""

    def __init__(self, speed_m_s: float) -> None:
        self._speed_m_s = speed_m_s
        self._validator = PoseValidator(lab(UPRIGHT))
        self._validator.note_motors({"left": True, "right": True})
        self._seq = 0

    def leader_code(self, exposed_s: float, stamp_s: float, off_m: float = 0.0) -> Rejection:
        """How the leader's pose of then is judged, where a frame is stamped `stamp_s`."""
        angle = self._speed_m_s / RADIUS_M * exposed_s
        pos = POSITIONS_LAB_M + 1e-4 * np.sin(1000.0 * exposed_s)
        pos[0] += [RADIUS_M * np.cos(angle) + off_m, 3.0 + RADIUS_M * np.sin(angle), 0.0]
        q = np.tile(frames.IDENTITY, (3, 1))
        q[0] = frames.from_yaw(np.array(angle))
        t_ns = T0_NS + round(stamp_s * 1e9)
        self._seq += 1
        shown = self._validator.judge(LabFrame(self._seq, t_ns, BODIES, pos, q, np.ones(3, np.bool_), t_ns), t_ns)
        return Rejection(shown.rejected[0])


@pytest.mark.parametrize("speed_m_s", [0.5, 2.0])
@pytest.mark.parametrize("is_lost", [False, True])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_leader_stamped_on_arrival_is_believed_through_bursts_and_gaps(
    seed: int, is_lost: bool, speed_m_s: float
) -> None:
    judge = Judge(speed_m_s)
    times = list(arrivals(seed, (0.03, 0.1, 0.2, 0.36, 0.87, 0.05, 0.87), is_lost))
    spacing_s = [after - before for (_, before), (_, after) in pairwise(times)]
    assert max(spacing_s) > 0.85
    assert is_lost or sum(spacing < 0.002 for spacing in spacing_s) > 200
    codes = [judge.leader_code(*each) for each in times]
    assert set(codes) == {Rejection.NONE}


def test_a_jump_within_a_burst_is_rejected_and_no_more_than_it() -> None:
    judge = Judge(1.0)
    times = list(arrivals(1, (0.36,), is_lost=False))
    jumps = {110, 111, 125}
    codes = [judge.leader_code(*each, 0.3 if k in jumps else 0.0) for k, each in enumerate(times)]
    assert all(codes[k] is Rejection.JUMP for k in jumps)
    wrong = [k for k, code in enumerate(codes) if code is not Rejection.NONE]
    assert len(wrong) <= len(jumps) + 2 * RECOVERY_FRAMES
    assert codes[-1] is Rejection.NONE


def test_cameras_that_become_faster_are_followed() -> None:
    """From 100 to 400 Hz, truly: after 300 frames speeds count by the new rhythm, and a jump still shows."""
    judge = Judge(2.0)
    times = [0.01 * k for k in range(100)] + [1.0 + 0.0025 * k for k in range(1200)]
    codes = [judge.leader_code(t_s, t_s) for t_s in times]
    assert set(codes) == {Rejection.NONE}
    assert judge.leader_code(times[-1] + 0.0025, times[-1] + 0.0025, 0.1) is Rejection.JUMP
