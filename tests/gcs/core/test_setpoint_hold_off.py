"""What a drone is sent while its pose is rejected, seen at the drone: level flight, nothing, then the law's again."""

import numpy as np
import pytest

from formation.guidance.plan import Mode
from formation.maths.frames import IDENTITY
from formation.messages import Phase
from tests.gcs.fakes import MS, FakeLab, flying, triangle


def sent(lab: FakeLab, since_ns: int) -> list[tuple[float, float]]:
    """To the drone `left` since then: how many ms later, and how far from level, rad."""
    return [
        ((t_ns - since_ns) / MS, 2.0 * float(np.hypot(*target.q_lab_from_flu[1:3])))
        for t_ns, target in lab.drones[2].setpoints
        if t_ns > since_ns
    ]


def test_a_drone_whose_pose_is_rejected_gets_level_setpoints_for_100_ms_then_none_until_believed_for_200_ms():
    lab = flying()
    since_ns = lab.now_ns
    lab.rejected.add("left")
    lab.run(0.15)
    status = sent(lab, since_ns)
    assert [round(ms) for ms, _ in status] == list(range(10, 101, 10))
    assert all(tilt_rad < 1e-6 for _, tilt_rad in status)
    assert all(target.thrust_norm <= lab.drones[2].hover + 0.02 for _, target in lab.drones[2].setpoints[-5:])
    assert lab.drones[3].setpoints[-1][0] == lab.now_ns
    lab.rejected.clear()
    since_ns = lab.now_ns
    lab.run(0.4)
    assert [round(ms) for ms, _ in sent(lab, since_ns)][:2] == [200, 210]
    assert lab.phase is Phase.FORMATION


def test_what_was_made_of_wrong_poses_is_forgotten():
    """Believed for 50 ms 0.3 m off, it would be led on by a velocity of metres a second that it never had."""
    lab = flying()
    lab.run(0.5)
    lab.shift_m["left"] = (0.3, 0.0, 0.0)
    lab.run(0.05)
    lab.shift_m.clear()
    lab.rejected.add("left")
    lab.run(0.05)
    lab.rejected.clear()
    lab.step()
    state = lab.core._stages.state
    assert np.linalg.norm(state.vel_lab_m_s[1]) < 0.1
    assert state.pos_lab_m[1] == pytest.approx(lab.drones[2].pos, abs=0.01)
    assert np.linalg.norm(state.vel_lab_m_s[0]) > 0.05  # nobody else's is: the leader is on its way


def test_a_drone_on_the_floor_gets_only_level_setpoints():
    lab = FakeLab(triangle())
    lab.run(2.0)
    lab.rejected.add("left")
    lab.run(0.3)
    assert lab.core._flight.plan().setpoints[1].mode is Mode.IDLE
    np.testing.assert_allclose(lab.core._stages.target.q_lab_from_flu[1], IDENTITY, atol=1e-6)
    assert lab.core._stages.target.thrust_norm[1] == 0.0
