"""When the leader's trajectory begins: at a time that was asked for; and where a hold interrupted it."""

import numpy as np
import pytest

from formation.messages import Phase, Verb
from formation.reasons import Reason
from tests.gcs.fakes import FakeLab, accepted, reasons, refusal, triangle

S = 1_000_000_000
LINE = {"kind": "line", "length_m": 1.2, "duration_s": 6.0}
LEAD = 1


@pytest.fixture
def lab() -> FakeLab:
    """Drones that hover, their leader before a line of 1.2 m along x."""
    lab = FakeLab(triangle(leader={"body": "lead", "sysid": LEAD, "trajectory": LINE}))
    lab.take_off()
    return lab


def begun(lab: FakeLab, longest_s: float = 20.0) -> None:
    """The trajectory has begun."""
    for _ in range(round(longest_s * 10)):
        if lab.state.trajectory_started:
            return
        lab.run(0.1)
    raise AssertionError("it does not begin")


def test_an_interrupted_trajectory_is_resumed_and_ends_where_it_would_have(lab: FakeLab) -> None:
    start_m = lab.drones[LEAD].pos.copy()
    lab.command(Verb.START, Phase.FORMATION)
    begun(lab)
    lab.run(2.5)
    lab.command(Verb.HOLD, Phase.HOLD)
    lab.run(2.0)
    accepted(lab, Verb.RESUME)
    lab.run(0.2)
    lab.command(Verb.HOLD, Phase.HOLD)  # before its slots are taken again: it interrupts nothing more
    lab.run(1.0)
    halted_m = lab.drones[LEAD].pos.copy()
    assert 0.2 < halted_m[0] - start_m[0] < 0.7
    accepted(lab, Verb.SHAPE, "column")
    accepted(lab, Verb.RESUME)
    begun(lab)
    flown = [lab.drones[LEAD].pos[0]]
    for _ in range(200):
        lab.step()
        flown.append(lab.drones[LEAD].pos[0])
    assert np.abs(np.diff(flown)).max() < 0.6 * 0.01  # it accelerates, from rest, to what the line asks for: 0.38 m/s
    lab.run(4.0)
    np.testing.assert_allclose(lab.drones[LEAD].pos[:2] - start_m[:2], [1.2, 0.0], atol=0.01)
    assert lab.state.trajectory_done
    assert lab.state.shape == "column"


def test_a_start_after_a_hold_begins_anew(lab: FakeLab) -> None:
    lab.command(Verb.START, Phase.FORMATION)
    begun(lab)
    lab.run(2.5)
    lab.command(Verb.HOLD, Phase.HOLD)
    lab.run(2.0)
    halted_m = lab.drones[LEAD].pos.copy()
    lab.command(Verb.START, Phase.FORMATION)
    begun(lab)
    lab.run(7.0)
    np.testing.assert_allclose(lab.drones[LEAD].pos - halted_m, [1.2, 0.0, 0.0], atol=0.01)


def test_nothing_is_resumed_that_was_not_interrupted(lab: FakeLab) -> None:
    assert reasons(lab, Verb.RESUME) == [Reason.NOT_INTERRUPTED]
    lab.command(Verb.START, Phase.FORMATION)
    assert reasons(lab, Verb.RESUME) == [Reason.OUT_OF_TURN]
    begun(lab)
    lab.run(7.0)  # to its end
    lab.command(Verb.HOLD, Phase.HOLD)
    assert reasons(lab, Verb.RESUME) == [Reason.NOT_INTERRUPTED]


def test_the_trajectory_begins_at_the_very_time_that_was_asked_for(lab: FakeLab) -> None:
    at_ns = lab.now_ns + 8 * S + 3_700_000  # between two ticks
    accepted(lab, Verb.START, str(at_ns))
    lab.run(7.9)
    assert not lab.state.trajectory_started
    lab.run(2.1)
    led = [record for name, record in lab.records if name == "control/reference"]
    away_m = led[-1].slot_lead_m[0, 0] - led[-250].slot_lead_m[0, 0]
    u = (led[-1].t_ns - at_ns) * 1e-9 / LINE["duration_s"]
    assert away_m == pytest.approx(LINE["length_m"] * (10 * u**3 - 15 * u**4 + 6 * u**5), abs=1e-6)


def test_slots_that_are_taken_too_late_are_waited_for_and_the_delay_is_told(lab: FakeLab) -> None:
    accepted(lab, Verb.START, str(lab.now_ns + S // 2))
    begun(lab)
    (told,) = [text for text in lab.events if "late" in text]
    assert told.startswith("the trajectory begins ")


def test_a_time_that_is_none_or_past_or_too_far_away_is_rejected(lab: FakeLab) -> None:
    for at in ("0", "-5", "soon", "12.5", "9" * 5000, "\u0663", str(10**15)):
        assert reasons(lab, Verb.START, at) == [Reason.NO_TIME]


def test_a_leader_that_is_only_observed_begins_when_it_likes() -> None:
    lab = FakeLab(triangle(leader={"body": "lead"}))
    lab.take_off()
    assert reasons(lab, Verb.START, str(lab.now_ns + S)) == [Reason.LEADER_OBSERVED]


def test_a_start_whose_trajectory_leaves_the_fence_is_rejected() -> None:
    lab = FakeLab(triangle(limits={"fence": {"low_m": (-1.0, -1.0, -0.1), "high_m": (0.8, 1.0, 2.3)}}))
    lab.take_off()
    lab.run(0.5)
    assert refusal(lab, Verb.START).startswith("lead: it would be outside the fence")
