"""Poses stamped as they arrive: bursts and gaps of a network that holds frames back, or loses them, reject nobody."""

from itertools import pairwise

import numpy as np
import pytest

from formation.maths import frames
from formation.messages import LabFrame, Rejection
from mocap.judge import RECOVERY_FRAMES
from mocap.validator import PoseValidator
from tests.mocap.test_retiming import Stream
from tests.mocap.validator_rig import BODIES, POSITIONS_LAB_M, T0_NS, UPRIGHT, lab

RADIUS_M = 1.0


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


@pytest.mark.parametrize("is_lost", [False, True])
def test_a_leader_stamped_on_arrival_is_believed_through_bursts_and_gaps(is_lost: bool) -> None:
    judge = Judge(2.0)
    exposed_s, arrived_s, _ = Stream(stalled_share=1.0 - is_lost, length_s=20.0).frames(2)
    times = list(zip(exposed_s, arrived_s, strict=True))
    spacing_s = [after - before for (_, before), (_, after) in pairwise(times)]
    assert max(spacing_s) > 0.85
    assert is_lost or sum(spacing < 0.002 for spacing in spacing_s) > 200
    codes = [judge.leader_code(*each) for each in times]
    assert set(codes) == {Rejection.NONE}


def test_a_jump_within_a_burst_is_rejected_and_no_more_than_it() -> None:
    judge = Judge(1.0)
    exposed_s, arrived_s, _ = Stream(stalls_s=(0.36,), length_s=1.3).frames(1)
    times = list(zip(exposed_s, arrived_s, strict=True))
    jumps = {60, 61, 75}
    codes = [judge.leader_code(*each, 0.3 if k in jumps else 0.0) for k, each in enumerate(times)]
    assert all(codes[k] is Rejection.JUMP for k in jumps)
    wrong = [k for k, code in enumerate(codes) if code is not Rejection.NONE]
    assert len(wrong) <= len(jumps) + 2 * RECOVERY_FRAMES
    assert codes[-1] is Rejection.NONE
