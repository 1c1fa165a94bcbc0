import numpy as np
import pytest

from formation.messages import Phase, Severity
from formation.safety.phases import AIRBORNE, Trigger
from formation.safety.rules import Facts, RuleState, Verdict, assess, start
from formation.safety.rules_table import RULES, Measure, Own, rules_markdown
from tests.formation.facts import LIMITS, healthy, of


def _after(facts: Facts, phase: Phase, lasting_s: float) -> Verdict:
    """The verdict when `facts` have lasted for a time, from health."""
    state, _ = assess(start(3), facts, phase, LIMITS, 0)
    return assess(state, facts, phase, LIMITS, round(lasting_s * 1e9))[1]


@pytest.mark.parametrize("phase", Phase)
def test_healthy_swarm_is_left_alone_in_every_phase(phase):
    verdict = _after(healthy(), phase, 10.0)
    assert verdict.trigger is None
    assert verdict.changes == ()
    assert not verdict.release.any()
    assert not verdict.cut.any()


FAULTS = {
    "leader hidden": ({"age_s": of(0, 0.25, 0.0)}, Phase.FORMATION, 0.0, Trigger.HOLD, Own.NOTHING),
    "body lost": ({"age_s": of(1, 0.45, 0.0)}, Phase.FORMATION, 0.0, Trigger.LAND, Own.RELEASE),
    "outside": (
        {"pos_lab_m": np.array([[0.0, 0, 0.3], [2.6, 0, 0.3], [0, 1, 0.3]])},
        Phase.HOLD,
        0.11,
        Trigger.LAND,
        Own.NOTHING,
    ),
    "far outside": (
        {"pos_lab_m": np.array([[0.0, 0, 0.3], [3.1, 0, 0.3], [0, 1, 0.3]])},
        Phase.HOLD,
        0.21,
        Trigger.LAND,
        Own.RELEASE,
    ),
    "close": (
        {"pos_lab_m": np.array([[0.0, 0, 0.3], [0.15, 0, 0.3], [0, 1, 0.3]])},
        Phase.FORMATION,
        0.11,
        Trigger.HOLD,
        Own.NOTHING,
    ),
    "very close": (
        {"pos_lab_m": np.array([[0.0, 0, 0.3], [0.09, 0, 0.3], [0, 1, 0.3]])},
        Phase.HOLD,
        0.11,
        Trigger.LAND,
        Own.NOTHING,
    ),
    "astray": ({"error_m": of(1, 1.1, 0.0)}, Phase.FORMATION, 1.01, Trigger.LAND, Own.NOTHING),
    "leader astray": ({"error_m": of(0, 0.35, 0.0)}, Phase.FORMATION, 0.11, Trigger.HOLD, Own.NOTHING),
    "upset": ({"tilt_rad": of(1, 1.5, 0.0)}, Phase.HOLD, 0.31, Trigger.LAND, Own.RELEASE),
    "stale": ({"setpoint_age_s": of(1, 0.15, 0.0)}, Phase.HOLD, 1.01, Trigger.LAND, Own.RELEASE),
    "late as it lands": ({"setpoint_age_s": of(1, 0.08, 0.0)}, Phase.LAND, 1.01, None, Own.RELEASE),
    "silent": ({"silent_s": of(1, 3.1, 0.0)}, Phase.FORMATION, 0.0, Trigger.LAND, Own.NOTHING),
    "mode lost": ({"offboard": of(1, False, True)}, Phase.FORMATION, 0.51, Trigger.LAND, Own.NOTHING),
    "disarmed": ({"armed": of(1, False, True)}, Phase.FORMATION, 0.31, Trigger.LAND, Own.NOTHING),
    "battery empty": ({"battery": of(1, 0.05, np.nan)}, Phase.FORMATION, 1.01, Trigger.LAND, Own.NOTHING),
    "late": ({"late_share": 0.8}, Phase.FORMATION, 2.01, Trigger.LAND, Own.NOTHING),
}


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_answered_once_it_has_lasted(name):
    changes, phase, lasting_s, trigger, own = FAULTS[name]
    verdict = _after(healthy(**changes), phase, lasting_s)
    assert verdict.trigger is trigger
    assert verdict.release.any() == (own is Own.RELEASE)
    assert verdict.cut.any() == (own is Own.CUT)


@pytest.mark.parametrize("name", [n for n, (_, _, lasting, _, _) in FAULTS.items() if lasting > 0.1])
def test_a_fault_that_does_not_last_is_let_pass(name):
    changes, phase, lasting_s, _, _ = FAULTS[name]
    assert _after(healthy(**changes), phase, 0.05).trigger is None
    state, _ = assess(start(3), healthy(**changes), phase, LIMITS, 0)
    state, _ = assess(state, healthy(), phase, LIMITS, 10_000_000)
    _, verdict = assess(state, healthy(**changes), phase, LIMITS, round(lasting_s * 1e9))
    assert verdict.trigger is None


def test_an_observed_leader_that_is_lost_is_waited_for_in_hold_and_landed_without():
    """Held at 0.2 s; its followers are seen, so nothing lands until 5 s; it has no link to be let go of."""
    observed = np.array([False, True, True])
    for age_s, phase, trigger in (
        (0.21, Phase.FORMATION, Trigger.HOLD),
        (4.9, Phase.HOLD, None),
        (5.1, Phase.HOLD, Trigger.LAND),
        (5.1, Phase.TAKEOFF, Trigger.LAND),
    ):
        verdict = _after(healthy(commanded=observed, age_s=of(0, age_s, 0.0)), phase, 0.0)
        assert verdict.trigger is trigger, (age_s, phase)
        assert not verdict.release.any()
        assert not verdict.cut.any()


def test_a_link_that_falls_behind_is_warned_of_then_held_then_its_drone_is_released():
    for behind_s, phase, trigger, released in (
        (0.04, Phase.FORMATION, None, False),
        (0.06, Phase.FORMATION, None, False),
        (0.12, Phase.FORMATION, Trigger.HOLD, False),
        (0.12, Phase.HOLD, None, False),
        (0.35, Phase.HOLD, Trigger.LAND, True),
        (np.nan, Phase.FORMATION, None, False),
    ):
        verdict = _after(healthy(link_behind_s=of(1, behind_s, 0.0)), phase, 1.0)
        assert verdict.trigger is trigger, behind_s
        assert verdict.release.tolist() == [False, released, False]
        assert not verdict.cut.any()
        assert bool(verdict.changes) == (behind_s > 0.05)


def test_only_the_drone_in_trouble_is_cut():
    verdict = _after(healthy(tilt_rad=of(2, 1.5, 0.0), own_tilt_rad=of(2, 1.5, 0.0)), Phase.HOLD, 0.4)
    assert verdict.cut.tolist() == [False, False, True]
    assert (verdict.fault.rule.name, verdict.fault.body) == ("rule-tilted", "right")
    assert verdict.fault.text == "right: tilted by 75 degrees"


def test_landing_outweighs_holding():
    facts = healthy(age_s=of(0, 0.25, 0.0), silent_s=of(2, 4.0, 0.0))
    assert _after(facts, Phase.FORMATION, 0.0).trigger is Trigger.LAND


def test_an_observed_leader_may_leave_the_fence_and_is_never_cut():
    facts = healthy(
        commanded=np.array([False, True, True]),
        pos_lab_m=np.array([[9.0, 0, 0.3], [-0.4, 0.4, 0.3], [-0.4, -0.4, 0.3]]),
        tilt_rad=of(0, 3.0, 0.0),
    )
    assert _after(facts, Phase.FORMATION, 5.0).trigger is None


def test_findings_tell_beginning_and_end_once():
    bad, good = healthy(silent_s=of(1, 4.0, 0.0)), healthy()
    state: RuleState = start(3)
    told = []
    for i, facts in enumerate((bad, bad, good, good)):
        state, verdict = assess(state, facts, Phase.HOLD, LIMITS, i * 10_000_000)
        told.append([(f.text, f.began, f.rule.severity) for f in verdict.changes])
    text = "left: nothing heard for 3 s"
    assert told == [[(text, True, Severity.ERROR)], [], [(text, False, Severity.ERROR)], []]


def test_a_late_loop_is_told_once_not_once_a_drone():
    verdict = _after(healthy(late_share=0.9), Phase.HOLD, 2.0)
    assert [f.text for f in verdict.changes] == ["a fifth of the frames late", "seven tenths of the frames late"]


def test_a_drone_that_is_not_what_its_profile_says_is_told_and_flies_on():
    verdict = _after(healthy(model_mismatch=of(2, 0.8, 0.0)), Phase.FORMATION, 1.1)
    assert verdict.trigger is None
    assert [(f.text, f.rule.severity) for f in verdict.changes] == [("right: model mismatch", Severity.WARNING)]


def test_motors_off_phases_ignore_the_air_rules():
    for phase in set(Phase) - AIRBORNE - {Phase.ARMED}:
        facts = healthy(age_s=np.full(3, np.inf), silent_s=np.full(3, np.inf), armed=np.zeros(3, bool))
        assert _after(facts, phase, 100.0).trigger is None


def test_documented_policy_has_every_rule():
    lines = rules_markdown().splitlines()
    assert len(lines) == 2 + len(RULES)
    assert all(rule.fault in line and f"`{rule.name}`" in line for rule, line in zip(RULES, lines[2:], strict=True))


@pytest.mark.parametrize("age_s", [0.45, np.inf])
def test_a_lost_body_takes_no_part_in_separation_and_fence(age_s):
    """Its last place, or the zeros of one never seen, would land drones that are nowhere near, or cut its motors."""
    observed = np.array([False, True, True])
    near = np.array([[0.0, 0, 0], [0.05, 0, 0.0], [0, 1, 0.3]])
    facts = healthy(commanded=observed, pos_lab_m=near, age_s=of(0, age_s, 0.0))
    assert {c.rule.measure for c in _after(facts, Phase.HOLD, 5.0).changes} <= {Measure.UNSEEN_S}
    away = np.array([[0.0, 0, 0.3], [9.0, 0, 0.3], [0, 1, 0.3]])
    verdict = _after(healthy(pos_lab_m=away, age_s=of(1, age_s, 0.0)), Phase.LAND, 5.0)
    assert verdict.release.tolist() == [False, True, False]
    assert not verdict.cut.any()


def test_those_that_are_seen_are_still_kept_apart_and_inside_beside_a_lost_body():
    near = np.array([[0.0, 0, 0], [1.0, 0, 0.3], [1.0, 0.05, 0.3]])
    facts = healthy(commanded=np.array([False, True, True]), pos_lab_m=near, age_s=of(0, 1.0, 0.0))
    verdict = _after(facts, Phase.HOLD, 0.2)
    assert (verdict.fault.rule.name, verdict.fault.body) == ("rule-half-separation", "left")
