"""The oracle on flights made by hand: each thing that must not happen is found, and what may happen is not."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sim.proof.oracle import Truth, Verdict, judge

DT_S = 0.01
LEVEL = (1.0, 0.0, 0.0, 0.0, 0.5)


def flown(seconds: float = 6.0, n: int = 2) -> Truth:
    """Up at 1 m/s to 1 m, there until 2 s before the end, down at 0.5 m/s and off; the onset at 2 s."""
    t_s = np.arange(0.0, seconds, DT_S)
    z = np.clip(np.minimum(t_s, 0.5 * (seconds - 0.5 - t_s)), 0.0, 1.0)
    pos_m = np.zeros((len(t_s), n, 3))
    pos_m[:, :, 0], pos_m[:, :, 2] = np.arange(n), z[:, None]
    return Truth(
        names=("one", "two", "three")[:n],
        t_s=t_s,
        pos_m=pos_m,
        vel_m_s=np.gradient(pos_m, DT_S, axis=0),
        up=np.ones((len(t_s), n)),
        armed=np.tile((t_s < seconds - 0.3)[:, None], (1, n)),
        thrust=np.ones((len(t_s), n)),
        command=np.tile(LEVEL, (len(t_s), n, 1)),
        command_age_s=np.full((len(t_s), n), 0.01),
        gain_low=np.ones((len(t_s), n)),
        gain_high=np.ones((len(t_s), n)),
        lift_most=np.full((len(t_s), n), 1.6),
        fence_low_m=np.array([-2.5, -2.0, -0.1]),
        fence_high_m=np.array([2.5, 2.0, 2.3]),
        t_onset_s=2.0,
    )


def between(truth: Truth, begin_s: float, end_s: float) -> np.ndarray:
    return (truth.t_s >= begin_s) & (truth.t_s < end_s)


def falling(truth: Truth, at_s: float = 2.5) -> Truth:
    """Drone one falls freely from 1 m with its motors off."""
    since = np.clip(truth.t_s - at_s, 0.0, None)
    height = np.maximum(1.0 - 0.5 * 9.81 * since**2, 0.0)
    pos, vel = truth.pos_m.copy(), truth.vel_m_s.copy()
    after = truth.t_s >= at_s
    pos[after, 0, 2] = height[after]
    vel[after, 0, 2] = np.where(height[after] > 0.0, -9.81 * since[after], 0.0)
    armed, thrust = truth.armed.copy(), truth.thrust.copy()
    armed[after, 0], thrust[after, 0] = False, 0.0
    return replace(truth, pos_m=pos, vel_m_s=vel, armed=armed, thrust=thrust)


def touch_down(truth: Truth) -> int:
    """When drone one is on the floor again."""
    begun = int((truth.pos_m[:, 0, 2] < 0.02).argmax()) + 10
    return begun + int((truth.pos_m[begun:, 0, 2] < 0.02).argmax())


def kinds(verdict: Verdict) -> list[str]:
    return sorted(set(verdict.kinds))


def apart(truth: Truth, when: np.ndarray, apart_m: float) -> None:
    truth.pos_m[when, 1, 0] = apart_m


def aside(truth: Truth, when: np.ndarray, y_m: float) -> None:
    truth.pos_m[when, 0, 1] = y_m


def aged(truth: Truth, when: np.ndarray, age_s: float) -> None:
    truth.command_age_s[when, 1] = age_s


def thrusting(truth: Truth, when: np.ndarray, thrust: float) -> None:
    truth.command[when, 0, 4] = thrust


def tilted(truth: Truth, when: np.ndarray, rad: float) -> None:
    truth.command[when, 0, :2] = np.cos(0.5 * rad), np.sin(0.5 * rad)


@pytest.mark.parametrize(
    ("change", "inside", "outside", "kind"),
    [
        (apart, 0.11, 0.09, "separation"),
        (aside, 2.49, 2.51, "fence"),
        (aside, -2.49, -2.51, "fence"),
        (aged, 0.25, 0.3, "command-age"),
        (aged, np.nan, 9.0, "command-age"),
        (thrusting, 1.0, 1.2, "command-bounds"),
        (thrusting, 0.0, np.nan, "command-bounds"),
        (tilted, 0.0, 1.3, "command-bounds"),
    ],
)
def test_each_limit(change: Callable[..., None], inside: float, outside: float, kind: str) -> None:
    for value, found in ((inside, []), (outside, [kind])):
        truth = flown()
        change(truth, between(truth, 3.0, 3.02), value)
        assert kinds(judge(truth, benign=True)) == found


def test_motors_cut_in_the_air_without_a_reason_and_the_impact() -> None:
    verdict = judge(falling(flown()))
    assert kinds(verdict) == ["impact", "undue-cut"]
    assert "4.4 m/s" in next(v.text for v in verdict.violations if v.kind == "impact")


@pytest.mark.parametrize("reason", ["stop", "dead motor", "upset", "far outside"])
def test_motors_cut_for_a_good_reason(reason: str) -> None:
    truth = falling(flown())
    match reason:
        case "stop":
            truth = replace(truth, stops_s=(2.4,))
            truth.armed[between(truth, 2.5, 9.0)] = False
            truth.pos_m[between(truth, 2.5, 9.0), 1, 2] = 0.0
        case "dead motor":
            truth.gain_low[truth.t_s >= 2.3, 0] = 0.0
        case "upset":
            truth.up[between(truth, 2.2, 2.5), 0] = 0.1
        case "far outside":
            truth.pos_m[between(truth, 2.4, 2.5), 0, 0] = 3.1
    assert kinds(judge(truth)) == (["fence"] if reason == "far outside" else [])


@pytest.mark.parametrize(("lift", "found"), [(1.05, []), (1.15, ["impact"])])
def test_motors_that_cannot_brake_it_are_no_reason_to_cut_them(lift: float, found: list[str]) -> None:
    """It falls at 2 m/s, with hardly its weight as thrust."""
    truth = flown()
    contact = touch_down(truth)
    truth.vel_m_s[contact - 2 : contact + 1, 0] = [0.0, 0.0, -2.0]
    truth.lift_most[truth.t_s >= 2.0, 0] = lift
    assert kinds(judge(truth)) == found
    truth.lift_most[contact - 20 :, 0] = 1.6  # sound again 0.2 s before
    assert kinds(judge(truth)) == found
    truth.lift_most[contact - 40 :, 0] = 1.6
    assert kinds(judge(truth)) == ["impact"]
    truth.lift_most[contact - 40 :, 0] = lift
    truth.armed[contact - 10 :, 0] = False
    assert kinds(judge(truth)) == sorted([*found, "undue-cut"])


def test_weak_motors_excuse_no_body_that_tumbles_with_them_running() -> None:
    """One dead motor leaves half of the thrust in balance; the others turn it over, and go on."""
    truth = flown()
    contact = touch_down(truth)
    truth.vel_m_s[contact - 2 : contact + 1, 0] = [0.0, 0.0, -2.0]
    truth.lift_most[truth.t_s >= 2.0, 0] = 1.0
    truth.gain_low[truth.t_s >= 2.0, 0] = 0.0
    truth.up[contact - 20 : contact + 1, 0] = -0.5
    assert kinds(judge(truth)) == ["impact"]  # turned over 0.2 s ago: who could have stopped it
    truth.up[contact - 40 : contact + 1, 0] = -0.5
    assert kinds(judge(truth)) == ["impact", "overturned"]
    truth.vel_m_s[contact - 2 : contact + 1, 0] = 0.0
    assert kinds(judge(truth)) == ["overturned"]
    truth.armed[contact - 10 :, 0] = False
    assert kinds(judge(truth)) == []


def test_a_flight_that_ends_armed_or_in_the_air_has_not_ended() -> None:
    truth = flown()
    truth.armed[-1, 0] = True
    truth.pos_m[-1, 1, 2] = 0.8
    assert [v.text for v in judge(truth).violations if v.kind == "no-end"] == [
        "one armed, 0.00 m up",
        "two off, 0.80 m up",
    ]


def test_what_is_unplanned_needs_a_cause_and_a_benign_fault_ends_nothing() -> None:
    unplanned = replace(flown(), planned=False)
    assert kinds(judge(unplanned)) == ["no-cause"]
    told = replace(unplanned, notes=((1.0, True, "before"), (2.1, False, "nothing"), (2.3, True, "LAND: why")))
    verdict = judge(told)
    assert verdict.contained
    assert verdict.cause == "LAND: why"
    assert verdict.detection_s == pytest.approx(0.3)
    assert kinds(judge(told, benign=True)) == ["nuisance"]


@pytest.mark.parametrize(
    ("alarms_s", "armed_s", "found"),
    [((), (), ["unrecorded"]), ((2.9,), (), []), ((3.1,), (), ["unrecorded"]), ((2.1,), (2.5,), ["unrecorded"])],
)
def test_a_log_that_is_not_written_is_told_of_within_a_second_and_nobody_arms(
    alarms_s: tuple[float, ...], armed_s: tuple[float, ...], found: list[str]
) -> None:
    truth = replace(flown(), log_ill_s=((2.0, 5.0),), log_alarms_s=alarms_s, armed_s=armed_s)
    assert kinds(judge(truth)) == found
