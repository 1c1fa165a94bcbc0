"""The one door for poses: what comes in raw goes out in the lab, and what is hostile does not stop what is not."""

from dataclasses import replace

import numpy as np
import pytest

from formation.config import LabConfig
from formation.messages import RawFrame
from mocap.core import MocapCore

MS = 1_000_000
T0_NS = 10**12


def a_core() -> MocapCore:
    return MocapCore(
        LabConfig.model_validate(
            {"leader": {"body": "lead"}, "followers": [{"body": "left", "sysid": 2, "offset_m": (0, 1, 0)}]}
        )
    )


def raw(k: int, **changes: object) -> RawFrame:
    """The k-th frame of a steady 100 Hz."""
    frame = RawFrame(
        k, T0_NS + k * 10 * MS, ("lead", "left"), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (2, 1)), np.ones(2, bool)
    )
    return replace(frame, **changes)


def at(k: int) -> int:
    return T0_NS + k * 10 * MS + 8 * MS


HOSTILE = {
    "two names and one pose": {"pos_mocap_m": np.zeros((1, 3))},
    "a capture in a hundred years": {"t_capture_ns": 2**62},
    "the same frame again": {"seq": 0, "t_capture_ns": T0_NS},
    "ten thousand names": {"bodies": ("",) * 10_000},
}


@pytest.mark.parametrize("change", HOSTILE.values(), ids=HOSTILE.keys())
def test_a_hostile_frame_is_rejected_and_the_next_is_taken(change):
    core = a_core()
    core.receive(raw(0), at(0))
    assert core.receive(raw(1, **change), at(1)) is None
    assert core.reject_log.count == 1
    assert core.receive(raw(2), at(2)) is not None


def test_a_pose_that_is_none_hides_its_body_alone():
    core = a_core()
    pos = np.array([[0.0, 0, 0], [1e200, 0, 0]])
    frame = core.receive(raw(0, pos_mocap_m=pos), at(0))
    assert frame is not None
    assert frame.seen.tolist() == [True, False]
    (event,) = core.reject_log.due(at(0))
    assert event.text == "refused: 1 x left: more than 1000 m away (millimetres?)"


def test_a_body_named_twice_is_left_out_and_said_once():
    core = a_core()
    twice = {"pos_mocap_m": np.zeros((3, 3)), "q_mocap_from_marker": np.tile([1.0, 0, 0, 0], (3, 1))}
    for k in range(2):
        frame = core.receive(raw(k, bodies=("left", "lead", "left"), seen=np.ones(3, bool), **twice), at(k))
        assert frame is not None
        assert frame.seen.tolist() == [True, False]
    (event,) = core.events(at(1))
    assert event.text.startswith("left is named 2 times by the source")
    assert core.reject_log.count == 0


def test_two_publishers_of_frames_are_said_once():
    core = a_core()
    for k in range(400):
        core.receive(raw(k), at(k))
        core.receive(raw(k, seq=k + 5000, t_capture_ns=T0_NS + k * 10 * MS - MS), at(k))
    texts = [event.text for event in core.events(at(400))]
    assert len(texts) == 1
    assert texts[0].startswith("two publishers of frames: numbers ")
    assert core.reject_log.count > 300
    (early,) = core.reject_log.due(at(400))
    assert int(early.text.split()[1]) < 50


def test_a_source_without_stamps_is_taken_at_its_delay():
    frame = a_core().receive(raw(0, t_capture_ns=0), at(0))
    assert frame is not None
    assert frame.t_capture_ns == at(0) - 8 * MS


def test_numbers_go_on_over_a_restart_which_is_an_event_and_gaps_stay():
    core, seqs = a_core(), []
    for k, seq in enumerate((505, 506, 509, 0, 1, 2, 3, 2**62, 4)):
        frame = core.receive(raw(k, seq=seq), at(k))
        seqs.append(frame and frame.seq)
    assert seqs == [0, 1, 4, None, None, 5, 6, None, 7]
    (event,) = core.events(at(9))
    assert event.text == "frame numbers begin anew, 2 after 509: the cameras were started again"
    assert core.reject_log.count == 3


OUT_OF_ORDER = {"overtaken": -4, "twice": -1, "another publisher's": 50_000, "forged": 2**62, "begun anew": -290}


@pytest.mark.parametrize("step", OUT_OF_ORDER.values(), ids=OUT_OF_ORDER)
def test_a_frame_out_of_order_is_dropped_and_counted_and_the_exposure_line_stays(step: int):
    """Two hundred frames without stamps would else be taken at their arrivals again, jitter and all."""
    core, rng, off_ns, texts = a_core(), np.random.default_rng(1), [], []
    for k in range(600):
        arrived_ns = at(k) + round(MS * rng.exponential())
        frame = core.receive(raw(k, t_capture_ns=0), arrived_ns)
        if k in (300, 301, 450):
            assert core.receive(raw(k, seq=k + step, t_capture_ns=0), arrived_ns + MS // 2) is None
        if frame is not None and k > 250:
            off_ns.append(frame.t_capture_ns - T0_NS - 10 * MS * k)
        texts += [event.text for event in (*core.events(at(k)), *core.reject_log.due(at(k + 200)))]
    assert max(map(abs, off_ns)) < MS
    assert core.reject_log.count == 3
    assert sum(int(text.split()[1]) for text in texts if text.endswith("frame out of order")) == 3
    assert not any("begin anew" in text for text in texts)


def test_bodies_of_others_are_named_up_to_a_bound():
    core = a_core()
    for k in range(100):
        core.receive(raw(k, bodies=("lead", f"wand {k}")), at(k))
    assert len(core.unknown) == 16


@pytest.mark.parametrize("is_stamped", [True, False])
def test_frames_stamped_on_arrival_are_re_timed_and_it_is_said_once(is_stamped: bool):
    """Every 40th frame is held back by 60 ms and those behind it with it; they come 0.3 ms after each other."""
    core, free_ns, out, texts = a_core(), 0, [], []
    for k in range(800):
        free_ns = max(at(k // 40 * 40) + 60 * MS, free_ns + 300_000) if k % 40 < 6 else max(at(k), free_ns + 300_000)
        frame = core.receive(raw(k, t_capture_ns=free_ns if is_stamped else 0), free_ns)
        texts += [event.text for event in core.events(free_ns)]
        if frame is not None:
            out.append((k, frame.t_capture_ns - T0_NS - 10 * MS * k))
    late_ns = 8 * MS if is_stamped else 0
    assert {k for k, _ in out} >= set(range(210, 800))
    assert max(abs(off_ns - late_ns) for k, off_ns in out if k >= 210) < 1 * MS
    assert len(texts) == 1
    assert texts[0].startswith("stamps are arrival times: frames are re-timed, with a scatter of 0.")
    assert core.retimed_scatter_s is not None
