"""What the pose validator rejects of flying bodies, in upright and turned rooms: when, and what it believes again.
Capture times that cannot be right hide every body, in frames that say so and are in order with the others.
Poses stamped as they arrive: bursts and gaps of a network that holds frames back, or loses them, reject nobody."""

import itertools
from itertools import pairwise

import numpy as np
import pytest

from formation.maths import frames
from formation.messages import LabFrame, Rejection
from mocap.core import MocapCore
from mocap.pose_checks import RECOVERY_FRAMES
from mocap.validator import PoseValidator, StampWatch
from tests.mocap.test_retiming import Stream
from tests.mocap.validator_rig import BODIES, MS, POSITIONS_LAB_M, T0_NS, TURNED, UPRIGHT, Fault, ValidatorRig, lab

MOUNTINGS = pytest.mark.parametrize("mounting", [UPRIGHT, TURNED], ids=["upright", "turned"])
LEFT, RIGHT = 1, 2
ALL = slice(None)
OVER = [0.0, 1.0, 0.0, 0.0]


def freezing(rows: int | slice = LEFT) -> Fault:
    """From its first frame on, the bodies stay as they are to the last bit."""
    held = []

    def freeze(k, pos, q):
        held[:] = held or [pos[rows].copy(), q[rows].copy()]
        pos[rows], q[rows] = held

    return freeze


def moved(by_m) -> Fault:
    return lambda k, pos, q: pos.__setitem__(LEFT, pos[LEFT] + by_m)


def turned(turn, row: int = LEFT) -> Fault:
    """turn: a quaternion, or how the frame's number gives one."""
    return lambda k, pos, q: q.__setitem__(
        row, frames.canonical(frames.multiply(q[row], turn(k) if callable(turn) else turn))
    )


def yaw(angle_rad: float) -> np.ndarray:
    return np.array([np.cos(angle_rad / 2), 0.0, 0.0, np.sin(angle_rad / 2)])


def swap(k, pos, q):
    pos[[LEFT, RIGHT]], q[[LEFT, RIGHT]] = pos[[RIGHT, LEFT]], q[[RIGHT, LEFT]]


def farthest_m(rig: ValidatorRig) -> float:
    """Of all shown positions, from where the bodies hover."""
    return max(np.abs(frame.pos_lab_m - POSITIONS_LAB_M).max() for frame in rig.shown)


@MOUNTINGS
def test_a_frozen_body_is_unseen_at_once_rejected_in_the_fifth_frame_and_believed_after_three_that_differ(mounting):
    r = ValidatorRig(mounting)
    r.fly(50, freezing())
    assert r.codes("left") == [Rejection.NONE] * 4 + [Rejection.FREEZE] * 46
    assert r.seen("left") == [True] + [False] * 49
    assert all(r.seen("right"))
    r.shown.clear()
    r.fly(10)
    assert r.seen("left") == [False] * 2 + [True] * 8
    r.fly(60)
    assert r.events == [
        "left is rejected, validator-freeze: frozen: the same to the last bit",
        "left is believed again: over 0.47 s, 48 x validator-freeze",
    ]


def test_cameras_that_send_each_pose_twice_are_seen_every_other_time_and_not_rejected():
    r, held = ValidatorRig(), {}

    def twice(k, pos, q):
        if k % 2:
            pos[:], q[:] = held["p"], held["q"]
        held["p"], held["q"] = pos.copy(), q.copy()

    r.fly(20, twice)
    assert r.seen("left") == [True, False] * 10
    assert not any(frame.rejected.any() for frame in r.shown)


def test_all_bodies_frozen_at_once_in_the_air_are_rejected_with_and_without_noise():
    r = ValidatorRig()
    r.fly(6, freezing(ALL))
    assert [frame.seen.any() for frame in r.shown] == [True] + [False] * 5
    assert (r.shown[-1].rejected == Rejection.FREEZE).all()
    r = ValidatorRig(noise_m=0.0, noise_rad=0.0)
    r.fly(10)
    assert r.codes("left")[-1] is Rejection.FREEZE
    assert r.codes("lead") == [Rejection.NONE] * 10


def test_a_body_frozen_as_it_takes_off_is_rejected():
    r = ValidatorRig()
    r.arm(False)
    r._standing = True
    r.fly(200)
    r.arm(True)
    r.shown.clear()
    r.fly(6, freezing())
    assert r.codes("left")[4:] == [Rejection.FREEZE] * 2


def test_a_mocap_that_is_started_in_flight_rejects_a_body_that_was_frozen_before():
    """It took the height at which it saw a body first, before the ground had told it of motors, for the floor."""
    r, freeze = ValidatorRig(), freezing()
    r.fly(3, freeze)
    r.core = MocapCore(r.config)
    r.fly(8, freeze)
    r.arm(True)
    r.shown.clear()
    r.fly(10, freeze)
    assert r.codes("left") == [Rejection.FREEZE] * 10
    assert all(r.seen("right"))


def test_cameras_without_noise_show_standing_bodies_as_they_are():
    """All of a simulation without noise, which stands on the floor, disarmed, beside one that is carried about."""
    r = ValidatorRig(
        noise_m=0.0, noise_rad=0.0, motion=lambda t_s: POSITIONS_LAB_M + np.outer([1, 0, 0], [0.3 * t_s, 0, 0])
    )
    r.arm(False)
    r._standing = True
    r.fly(500)
    assert all(frame.seen.all() for frame in r.shown[60:])  # after the room's own leap to the floor


@MOUNTINGS
def test_a_jump_is_rejected_at_once_and_believed_on_the_floor_alone(mounting):
    """A ground that restarts in flight, without heartbeats, makes no drone stand: its first state once did."""
    r = ValidatorRig(mounting)
    r.core.note_motors({})
    jump = moved([1.0, 0.0, 0.0])
    r.fly(60, jump)
    assert r.codes("left") == [Rejection.JUMP] * 60
    r.shown.clear()
    r.fly(5)
    assert r.seen("left") == [False, False, True, True, True]
    r.shown.clear()
    r.fly(600, jump)
    assert not any(r.seen("left"))
    r.arm(False)
    r.fly(2, jump)
    assert r.seen("left")[-1]


@pytest.mark.parametrize("jump_m", [0.08, 5.0])
def test_one_glitch_costs_three_frames(jump_m):
    r = ValidatorRig()
    r.fly(10, lambda k, pos, q: pos.__setitem__(LEFT, pos[LEFT] - [0.0, jump_m * (k == 2), 0.0]))
    assert r.seen("left") == [True, True, False, False, False] + [True] * 5
    assert r.core.rejections()["left"]["validator-jump"] == 3


def test_a_drone_that_was_hidden_for_half_a_second_is_believed_where_it_comes_back_but_no_ghost_for_good():
    r = ValidatorRig()
    r.fly(50, seen=(True, False, True))
    assert r.codes("left") == [Rejection.NONE] * 50
    r.shown.clear()
    r.fly(5, moved([0.8, 0.0, -0.3]))
    assert all(r.seen("left"))
    r = ValidatorRig()
    r.fly(50, seen=(True, False, True))
    r.fly(1, moved(0.5))
    r.shown.clear()
    r.fly(5)
    assert r.seen("left") == [False, False, True, True, True]


def test_a_drone_that_turned_back_while_it_was_hidden_is_believed_from_its_first_frame_on():
    """It rose at 2 m/s, lost thrust for half a second, and sinks at 2 m/s: no leap that its attitude contradicts."""

    def thrown(t_s):
        rising_s, falling_s = min(max(t_s - 2.2, 0.0), 0.3), min(max(t_s - 2.5, 0.0), 0.5)
        height_m = 2.0 * (rising_s + falling_s) - 4.0 * falling_s**2 - 2.0 * max(t_s - 3.0, 0.0)
        return POSITIONS_LAB_M + np.array([0.0, 0.0, height_m])

    r = ValidatorRig(motion=thrown)
    r.fly(30)
    r.fly(50, seen=(True, False, True))
    r.fly(30)
    assert all(r.seen("left")[:30])
    assert all(r.seen("left")[80:])


@MOUNTINGS
@pytest.mark.parametrize(
    ("body", "turn", "code"),
    [
        ("left", OVER, Rejection.FLIP),
        ("lead", yaw(0.4), Rejection.YAW_RATE),
        ("lead", yaw(2.0), Rejection.YAW_RATE),
        ("left", yaw(0.25), Rejection.YAW_RATE),
    ],
)
def test_a_body_turned_over_or_aside_is_rejected_at_once_and_believed_three_frames_after(mounting, body, turn, code):
    r = ValidatorRig(mounting)
    r.fly(20, turned(turn, BODIES.index(body)))
    assert r.codes(body) == [code] * 20
    r.shown.clear()
    r.fly(4)
    assert r.seen(body) == [False, False, True, True]


def test_a_slow_roll_that_its_path_disagrees_with_is_rejected():
    """Over in a third of a second, which the vehicle could do; but it hangs in the air."""
    r = ValidatorRig()
    r.fly(60, turned(lambda k: [np.cos(min(0.05 * k, np.pi / 2)), 0.0, np.sin(min(0.05 * k, np.pi / 2)), 0.0]))
    codes = r.codes("left")
    over = codes.index(Rejection.FLIP)
    # Rotors would push with 3 m/s2 at 108 degrees, in the 19th frame.
    assert 19 + 4 <= over <= 19 + 6
    assert set(codes[over:]) == {Rejection.FLIP}


def test_a_drone_that_falls_turning_over_is_believed():
    """Thrown, without thrust: it falls as it turns."""
    r = ValidatorRig(motion=lambda t_s: POSITIONS_LAB_M - np.outer([0, 1, 0], [0, 0, 4.9 * max(t_s - 2.3, 0.0) ** 2]))
    r.fly(40, turned(lambda k: [np.cos(0.05 * max(k - 10, 0)), np.sin(0.05 * max(k - 10, 0)), 0.0, 0.0]))
    assert all(r.seen("left"))


def test_a_drone_that_two_motors_turn_about_its_own_axis_is_seen_to_the_floor():
    """paper_40g: 0.4 N at 10 mm about 2.9e-5 kg m^2, less a quarter for the air; 0.25 s to 26 rad/s."""
    r = ValidatorRig(TURNED)
    r.fly(80, turned(lambda k: yaw(0.5 * 103.0 * (0.01 * min(k, 25)) ** 2 + 26.0 * 0.01 * max(k - 25, 0))))
    assert all(r.seen("left"))


@pytest.mark.parametrize("yaws_rad", [(0.2, 0.06), (0.08, -0.15, -0.06), (0.3, 0.16, 0.3, 0.1)])
def test_outlier_headings_that_lead_back_to_the_true_one_cost_three_frames_more(yaws_rad):
    """Each follows from the one before it, as does the first true one from the last: only the first was a leap."""
    r = ValidatorRig(TURNED)
    r.fly(len(yaws_rad) + 20, turned(lambda k: yaw(yaws_rad[k] if k < len(yaws_rad) else 0.0)))
    assert Rejection.YAW_RATE in r.codes("left")
    assert all(r.seen("left")[len(yaws_rad) + 2 :])


def test_a_wrong_heading_that_jitters_is_not_believed():
    """By two degrees every other frame: it leaps, but stays far from the true one."""
    r = ValidatorRig()
    r.fly(200, turned(lambda k: yaw(0.25 + 0.035 * (k % 2))))
    assert not any(r.seen("left"))


@pytest.mark.parametrize("ahead_m", [0.12, 0.6])
def test_a_ghost_that_stands_in_the_way_of_a_moving_body_is_not_believed_when_it_would_be_there(ahead_m):
    r = ValidatorRig(motion=lambda t_s: POSITIONS_LAB_M + np.array([max(t_s - 2.2, 0.0), 0.0, 0.0]))
    r.fly(30)
    r.shown.clear()
    ghost_m = []

    def ghost(k, pos, q):
        ghost_m[:] = ghost_m or [pos[LEFT] + [ahead_m, 0.0, 0.0]]
        pos[LEFT] = ghost_m[0] + [0.0, 0.0, 1e-4 * (k % 3)]

    r.fly(100, ghost)
    assert not any(r.seen("left"))


@MOUNTINGS
def test_two_swapped_drones_are_reassigned(mounting):
    r = ValidatorRig(mounting)
    exchange = swap
    if mounting is TURNED:  # their names are swapped, but not their markers
        q_marker = frames.multiply(frames.inverse(np.array(TURNED["left"])), np.array([1.0, 0.0, 0.0, 0.0]))

        def exchange(k, pos, q):
            pos[[LEFT, RIGHT]] = pos[[RIGHT, LEFT]]
            left = frames.multiply(q[RIGHT], frames.inverse(q_marker))
            right = frames.multiply(q[LEFT], q_marker)
            q[LEFT], q[RIGHT] = frames.canonical(left), frames.canonical(right)

    r.fly(60, exchange)
    assert all(frame.seen.all() for frame in r.shown)
    assert farthest_m(r) < 0.01
    assert max(np.abs(frame.q_lab_from_flu - frames.IDENTITY).max() for frame in r.shown) < 0.01
    r.fly(100)
    assert r.events == [
        "validator-swap: two bodies were swapped; their poses are reassigned",
        "no bodies are swapped any more: over 0.59 s, 60 x validator-swap",
    ]


EXCHANGE = {"exchanged before": (20, True), "exchanged in it": (0, True), "over before it ends": (20, False)}
"""How many frames before the gap, and whether after it."""


@pytest.mark.parametrize("gap", [5, 40])
@pytest.mark.parametrize("when", EXCHANGE)
def test_a_gap_of_all_poses_does_not_pass_swapped_drones_off_as_each_other(when, gap):
    """After a third of a second either could be where the other was, and was believed to be."""
    r = ValidatorRig()
    before, after = EXCHANGE[when]
    r.fly(before, swap)
    r.pause(gap)
    r.fly(30, swap if after else lambda *_: None)
    r.fly(30)
    assert all(frame.seen.all() for frame in r.shown)
    assert farthest_m(r) < 0.01


@pytest.mark.parametrize("gap", [10, 45])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_drones_that_brake_in_a_gap_behind_each_other_do_not_count_as_swapped(gap, direction):
    """Half a metre apart and at 1.5 m/s, one after the other or side by side; they stop as the poses end."""
    offset_m = np.array([[0.0, 0.0, 0.0], [0.0, -0.25, 0.0], [0.0, 0.25, 0.0]])
    ends_s, speed_m_s = 3.0, 1.5

    def motion(t_s):
        gone_m = speed_m_s * min(t_s, ends_s) + max(0.0, 0.3 * (1.0 - np.exp(-(t_s - ends_s) / 0.2)))
        return POSITIONS_LAB_M + offset_m + gone_m * np.array([*direction, 0.0])

    r = ValidatorRig(motion=motion)
    while r.t_s < ends_s:
        r.fly(1)
    r.pause(gap)
    r.shown.clear()
    r.fly(30)
    assert all(frame.seen.all() for frame in r.shown)
    assert r.events == []


def test_two_drones_swapped_whose_attitudes_do_not_fit_are_rejected_and_so_are_three_in_a_ring():
    r = ValidatorRig()

    def exchange(k, pos, q):
        pos[[LEFT, RIGHT]] = pos[[RIGHT, LEFT]]
        turned([0.8, 0.0, 0.0, 0.6])(k, pos, q)

    r.fly(30, exchange)
    assert r.codes("left") == r.codes("right") == [Rejection.SWAP] * 30
    assert all(r.seen("lead"))
    r = ValidatorRig()
    r.fly(5, lambda k, pos, q: pos.__setitem__(ALL, pos[[1, 2, 0]]))
    assert not any(frame.seen.any() for frame in r.shown)


def test_a_pose_that_is_none_says_why_and_the_next_is_believed():
    r = ValidatorRig()
    r.fly(3, lambda k, pos, q: pos.__setitem__((LEFT, 0), np.nan) if k == 1 else None)
    assert r.codes("left") == [Rejection.NONE, Rejection.NOT_FINITE, Rejection.NONE]
    assert r.seen("left") == [True, False, True]
    assert r.core.rejections() == {"left": {"not finite": 1}}


FAULTS = {
    "validator-jump": moved(1.0),
    "validator-flip": turned(OVER),
    "validator-yaw-rate": turned([0.6, 0, 0, 0.8]),
    "validator-swap": lambda k, pos, q: pos.__setitem__([LEFT, RIGHT], pos[[RIGHT, LEFT]]),
    "validator-freeze": lambda k, pos, q: (
        pos.__setitem__(LEFT, POSITIONS_LAB_M[LEFT]),
        q.__setitem__(LEFT, frames.IDENTITY),
    ),
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_check_that_is_switched_off_lets_its_fault_through(name):
    watching, unwatched = ValidatorRig(), ValidatorRig(without=frozenset({name}))
    for rig in (watching, unwatched):
        rig.fly(20, FAULTS[name])
    assert all(unwatched.seen("left"))
    shown_m = [frame.pos_lab_m[LEFT] for frame in watching.shown]
    assert not all(watching.seen("left")) or np.abs(np.array(shown_m) - POSITIONS_LAB_M[LEFT]).max() < 0.01


def in_order(rig: ValidatorRig) -> bool:
    stamps = [frame.t_capture_ns for frame in rig.shown]
    return all(a < b for a, b in itertools.pairwise(stamps))


@pytest.mark.parametrize("ahead_ms", [11, 900])
def test_a_capture_that_runs_ahead_is_rejected_at_once_and_as_long_as_drones_fly(ahead_ms):
    r = ValidatorRig()
    for _ in range(80):
        r.show(stamp_ns=ahead_ms * MS)
    assert all((frame.rejected == Rejection.STAMP).all() for frame in r.shown)
    assert len(r.shown) == 80
    r.fly(100)
    assert in_order(r)
    assert [frame.seen.all() for frame in r.shown[-98:]] == [True] * 98
    assert sum("validator-stamp" in text for text in r.events) == 6


def test_growing_latency_is_rejected_beyond_150_ms():
    r = ValidatorRig()
    for k in range(300):
        r.show(stamp_ns=-k * MS)
    shown = [int(frame.seen.all()) for frame in r.shown]
    assert shown == [1] * 151 + [0] * (len(shown) - 151)
    assert in_order(r)


def test_another_rhythm_is_taken_up_on_the_floor():
    r = ValidatorRig()
    r.arm(False)
    for _ in range(60):
        r.show(stamp_ns=-400 * MS)
    assert [frame.seen.all() for frame in r.shown] == [False] * 50 + [True] * 10


def test_a_source_that_starts_late_settles_at_its_quickest():
    """Its first frame took 90 ms, which says nothing against the second."""
    watch = StampWatch()
    arrivals = [(8 + 90, 90), *[(8 + 10 * k, 8) for k in range(10, 200)]]
    assert not any(watch.rejects((at - delay) * MS, at * MS, True) for at, delay in arrivals)
    assert watch.likely_ns(2000 * MS) == pytest.approx(1992 * MS, abs=1000)


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
