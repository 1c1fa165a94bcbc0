"""What faults make of frames, in a room whose cameras are turned: each is said in lab and flu."""

from math import pi

import numpy as np
import pytest

from formation.config import LabConfig
from formation.maths import frames
from formation.messages import RawFrame
from mocap.core import MocapCore
from sim.faults.fault import Family, Fault
from sim.faults.poses import CameraFaults, Thinning, late_ns
from sim.proof.labs import scenario

S = 1_000_000_000
TURNED = (0.7, -0.1, 0.5, 0.5)
BODIES = ("leader", "f2", "f3")
PLACES = np.array([[0.3, 0.0, 1.0], [-0.3, -0.3, 1.0], [-0.3, 0.3, 1.0]])


def lab() -> LabConfig:
    plain = scenario().lab
    mocap = plain.mocap.model_copy(update={"q_lab_from_mocap": TURNED})
    marker = {"q_marker_from_flu": (0.5, 0.5, -0.5, 0.5)}
    return plain.model_copy(
        update={
            "mocap": mocap,
            "leader": plain.leader.model_copy(update=marker),
            "followers": tuple(f.model_copy(update=marker) for f in plain.followers),
        }
    )


def raw(t_ns: int, shift_m: float = 0.0) -> RawFrame:
    """Everybody level, facing along x, moved along x."""
    q_mocap_from_lab = frames.inverse(np.array(TURNED))
    q = frames.multiply(q_mocap_from_lab, frames.inverse(np.array((0.5, 0.5, -0.5, 0.5))))
    pos = frames.rotate(q_mocap_from_lab, PLACES + np.array([shift_m, 0.0, 0.0]))
    return RawFrame(t_ns // 10_000_000, t_ns, BODIES, pos, np.tile(q, (3, 1)), np.ones(3, np.bool_))


def seen(fault: Fault, *, since_s: float = 0.0, shift_m: float = 0.0, faults: CameraFaults | None = None):
    """The frame in lab and flu, `since_s` after the onset."""
    now_ns = 5 * S + round(since_s * S)
    altered, _ = (faults or CameraFaults(lab(), 1)).alter(raw(now_ns, shift_m), [(0, fault, 5 * S)], now_ns)
    frame = MocapCore(lab()).receive(altered, now_ns)
    assert frame is not None
    return frame


def test_a_frozen_body_keeps_every_bit_while_the_others_move() -> None:
    faults, fault = CameraFaults(lab(), 1), Fault(family=Family.FREEZE, body="f2")
    first, later = (seen(fault, since_s=dt, shift_m=dt, faults=faults) for dt in (0.0, 0.3))
    assert np.array_equal(first.pos_lab_m[1], later.pos_lab_m[1])
    np.testing.assert_allclose(later.pos_lab_m[0] - first.pos_lab_m[0], [0.3, 0.0, 0.0], atol=1e-9)


def test_a_jump_goes_where_it_is_told_and_a_drift_grows() -> None:
    frame = seen(Fault(family=Family.JUMP, body="f2", severity=1.0, heading_rad=-pi / 2))
    np.testing.assert_allclose(frame.pos_lab_m - PLACES, [[0, 0, 0], [0, -1, 0], [0, 0, 0]], atol=1e-9)
    frame = seen(Fault(family=Family.DRIFT, body="f3", severity=0.05, heading_rad=0.0), since_s=2.0)
    np.testing.assert_allclose(frame.pos_lab_m[2] - PLACES[2], [0.1, 0, 0], atol=1e-9)


def test_a_flipped_body_is_upside_down_and_faces_the_same_way() -> None:
    frame = seen(Fault(family=Family.FLIP, body="f2", severity=pi))
    np.testing.assert_allclose(frames.rotate(frame.q_lab_from_flu[1], np.array([0.0, 0.0, 1.0])), [0, 0, -1], atol=1e-9)
    np.testing.assert_allclose(frames.rotate(frame.q_lab_from_flu[1], np.array([1.0, 0.0, 0.0])), [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(np.abs(frame.q_lab_from_flu[0]), [1, 0, 0, 0], atol=1e-9)


def test_a_wrong_yaw_is_wrong_about_the_labs_z() -> None:
    frame = seen(Fault(family=Family.YAW, body="leader", severity=1.0))
    assert frames.yaw(frame.q_lab_from_flu[0]) == pytest.approx(1.0)
    assert frames.yaw(frame.q_lab_from_flu[1]) == pytest.approx(0.0, abs=1e-9)


def test_swapped_bodies_stand_in_each_others_places() -> None:
    frame = seen(Fault(family=Family.SWAP, body="leader", other="f3"))
    np.testing.assert_allclose(frame.pos_lab_m, PLACES[[2, 1, 0]], atol=1e-9)


@pytest.mark.parametrize("family", [Family.LOST_BODY, Family.NOT_A_NUMBER])
def test_a_body_lost_or_not_a_number_is_not_seen(family: Family) -> None:
    assert seen(Fault(family=family, body="f2")).seen.tolist() == [True, False, True]


def test_noise_moves_a_body_every_frame_and_repeats_with_the_seed() -> None:
    fault = Fault(family=Family.NOISE, body="f2", severity=0.01)
    one, same = CameraFaults(lab(), 1), CameraFaults(lab(), 1)
    first, second = seen(fault, faults=one), seen(fault, since_s=0.01, faults=one)
    assert 0.0 < np.linalg.norm(first.pos_lab_m[1] - PLACES[1]) < 0.1
    assert not np.array_equal(first.pos_lab_m[1], second.pos_lab_m[1])
    assert np.array_equal(first.pos_lab_m, seen(fault, faults=same).pos_lab_m)


@pytest.mark.parametrize(
    ("family", "severity", "late_s"), [(Family.HIDDEN_LATENCY, 0.2, 0.2), (Family.STAMP_OFFSET, -0.2, 0.0)]
)
def test_stamps_are_offset_and_frames_are_late_by_what_the_stamp_hides(
    family: Family, severity: float, late_s: float
) -> None:
    altered, delay_ns = CameraFaults(lab(), 1).alter(
        raw(5 * S), [(0, Fault(family=family, severity=severity), 5 * S)], 5 * S
    )
    assert (altered.t_capture_ns, delay_ns) == (5 * S + round(severity * S), round(late_s * S))


def test_a_slow_stream_lets_an_even_share_through() -> None:
    thinning, fault = Thinning(), Fault(family=Family.SLOW_STREAM, severity=0.75)
    assert [thinning.passes([fault]) for _ in range(8)] == [True, False, False, False] * 2
    assert not Thinning().passes([Fault(family=Family.LOST_STREAM)])
    assert Thinning().passes([])


def test_late_frames_are_late() -> None:
    assert late_ns([Fault(family=Family.LATE_STREAM, severity=0.1)]) == S // 10
