"""Frames that no honest source sends are refused in words, in time that grows with their size alone."""

from dataclasses import replace

import numpy as np
import pytest

from formation.messages import LabFrame, RawFrame, Rejection
from wire.transport.frame_check import lab_fault, raw_fault

NOW_NS = 10**12
MS = 1_000_000
RAW = RawFrame(7, NOW_NS - 8 * MS, ("a", "b"), np.zeros((2, 3)), np.eye(2, 4), np.ones(2, bool))
LAB = LabFrame(7, NOW_NS - 8 * MS, ("a",), np.zeros((1, 3)), np.eye(1, 4), np.ones(1, bool), NOW_NS)


@pytest.mark.parametrize(
    "change",
    [
        {"pos_mocap_m": np.zeros((1, 3))},
        {"q_mocap_from_marker": np.eye(1, 4)},
        {"seen": np.ones(3, bool)},
    ],
)
def test_rows_must_be_as_many_as_names(change):
    assert "unequal numbers" in (raw_fault(replace(RAW, **change), NOW_NS) or "")


@pytest.mark.parametrize("t_ns", [2**62, NOW_NS + 21 * MS, NOW_NS - 1000 * MS, -5])
def test_a_capture_must_lie_between_a_second_ago_and_now(t_ns):
    assert "captured" in (raw_fault(replace(RAW, t_capture_ns=t_ns), NOW_NS) or "")
    assert "captured" in (lab_fault(replace(LAB, t_capture_ns=t_ns), NOW_NS) or "")
    for edge_ns in (0, NOW_NS + 20 * MS, NOW_NS - 999 * MS):
        assert raw_fault(replace(RAW, t_capture_ns=edge_ns), NOW_NS) is None


def test_a_thousand_bodies_are_a_frame_and_one_more_is_none():
    def of(n: int) -> RawFrame:
        return RawFrame(1, NOW_NS, tuple(map(str, range(n))), np.zeros((n, 3)), np.eye(n, 4), np.ones(n, bool))

    assert raw_fault(of(1000), NOW_NS) is None
    assert "more than 1000 bodies" in (raw_fault(of(1001), NOW_NS) or "")


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200, -3000.0])
def test_no_position_beyond_any_room_passes_as_a_lab_frame(value):
    assert "a pose that is none" in (lab_fault(replace(LAB, pos_lab_m=np.full((1, 3), value)), NOW_NS) or "")


@pytest.mark.parametrize("q", [[0, 0, 0, 0], [1, 1, 0, 0], [np.nan, 0, 0, 0]])
def test_no_quaternion_that_is_no_rotation_passes_as_a_lab_frame(q):
    assert lab_fault(replace(LAB, q_lab_from_flu=np.array([q], float)), NOW_NS) is not None


def test_a_rejection_code_that_is_none_is_refused():
    for code in (len(Rejection), 200, 255):
        fault = lab_fault(replace(LAB, rejected=np.array([code], np.uint8)), NOW_NS)
        assert fault == "with a rejection code that is none"
    for rejection in Rejection:
        assert lab_fault(replace(LAB, rejected=np.array([rejection], np.uint8)), NOW_NS) is None


@pytest.mark.parametrize("field", ["t_capture_ns", "t_receive_ns"])
def test_no_lab_frame_comes_from_the_future(field):
    """15 ms ahead, and drifting, forged frames displaced the true ones."""
    assert "future" in (lab_fault(replace(LAB, **{field: NOW_NS + 3 * MS}), NOW_NS) or "")
    assert lab_fault(replace(LAB, **{field: NOW_NS + 1 * MS}), NOW_NS) is None
    assert raw_fault(replace(RAW, t_capture_ns=NOW_NS + 15 * MS), NOW_NS) is None
