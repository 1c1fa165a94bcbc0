import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.config import LabConfig
from formation.maths import frames
from formation.messages import LabFrame, RawFrame, Rejection
from mocap.alignment import Alignment

HALF = math.sqrt(0.5)


def _lab(mocap=None, **left) -> LabConfig:
    return LabConfig.model_validate(
        {
            "mocap": mocap or {},
            "leader": {"body": "lead"},
            "followers": [{"body": "left", "sysid": 2, "offset_m": (0, 1, 0), **left}],
        }
    )


def _aligned(raw: RawFrame, mocap=None, **left) -> tuple[LabFrame, list[int]]:
    frame = Alignment(_lab(mocap, **left)).align(raw, 1, 5, 6)
    return frame, frame.rejected.tolist()


def _frame(bodies, pos, q=None, seen=None) -> RawFrame:
    n = len(bodies)
    q = np.tile(frames.IDENTITY, (n, 1)) if q is None else np.array(q, float)
    seen = np.ones(n, bool) if seen is None else np.array(seen)
    return RawFrame(8, 9, tuple(bodies), np.array(pos, float).reshape(n, 3), q, seen)


def test_bodies_come_in_the_configurations_order_and_strangers_are_left_out():
    out, _ = _aligned(_frame(["wand", "left", "lead"], [[9, 9, 9], [1, 2, 3], [4, 5, 6]]))
    assert out.bodies == ("lead", "left")
    assert out.pos_lab_m.tolist() == [[4, 5, 6], [1, 2, 3]]
    assert out.seen.tolist() == [True, True]
    assert (out.seq, out.t_capture_ns, out.t_receive_ns) == (1, 5, 6)


def test_bodies_that_the_frame_lacks_or_does_not_see_are_unseen_and_not_judged():
    for raw in (_frame(["left"], [[math.nan] * 3], seen=[False]), _frame([], [])):
        out, faults = _aligned(raw)
        assert out.seen.tolist() == [False, False]
        assert faults == [0, 0]


@pytest.mark.parametrize(
    ("pos", "q", "fault"),
    [
        ([0, 0, math.nan], [1, 0, 0, 0], Rejection.NOT_FINITE),
        ([1, 2, 3], [0, 0, 0, 0], Rejection.NO_ROTATION),
        ([0, 0, 1001.0], [1, 0, 0, 0], Rejection.TOO_FAR),
    ],
)
def test_poses_that_are_none_are_unseen_and_named(pos, q, fault):
    out, faults = _aligned(_frame(["lead", "left"], [pos, [1, 2, 3]], [q, [1, 0, 0, 0]]))
    assert out.seen.tolist() == [False, True]
    assert np.isfinite(out.pos_lab_m).all()
    assert np.isfinite(out.q_lab_from_flu).all()
    assert faults == [fault, 0]


def test_a_y_up_mocap_is_turned_upright():
    # y up, x right, z backwards, as OptiTrack: mocap x -> lab x, y -> z, z -> -y is a quarter turn about x.
    mocap = {"q_lab_from_mocap": (HALF, HALF, 0, 0), "origin_lab_m": (0.0, 0.0, 0.1)}
    out, _ = _aligned(_frame(["lead", "left"], [[1, 2, 3], [0, 0, 0]]), mocap)
    assert np.allclose(out.pos_lab_m[0], [1, -3, 2.1])
    assert np.allclose(out.q_lab_from_flu[0], [HALF, HALF, 0, 0])


@given(st.lists(st.floats(-1, 1), min_size=12, max_size=12))
def test_the_compiled_alignment_is_the_product_of_its_frames(numbers):
    q = np.array(numbers).reshape(3, 4) + np.array([3.0, 0, 0, 0])
    q_lab_from_mocap, q_mocap_from_marker, q_marker_from_flu = frames.canonical(q)
    raw = _frame(["left"], [[1, 2, 3]], [q_mocap_from_marker])
    mocap = {"q_lab_from_mocap": tuple(q_lab_from_mocap)}
    out, _ = _aligned(raw, mocap, q_marker_from_flu=tuple(q_marker_from_flu))
    expected = frames.multiply(frames.multiply(q_lab_from_mocap, q_mocap_from_marker), q_marker_from_flu)
    assert np.allclose(out.q_lab_from_flu[1], frames.canonical(expected))
    assert np.allclose(out.pos_lab_m[1], frames.rotate(q_lab_from_mocap, np.array([1.0, 2.0, 3.0])))
