"""A link that falls behind: what is old is known to be old, acted on, and confirms nothing that cuts motors."""

import numpy as np

from formation.messages import Phase
from tests.gcs.fakes import AHEAD_NS, MS, FakeLab, commands, flying


def behind(lab: FakeLab, sysid: int, late_ms: int, *, every: int = 1) -> None:
    """From now on what that drone says of its motion arrives so late, as out of a queue that is full.

    every: only the newest of so many steps comes, as from a machine that stalls.
    """
    drone, waiting = lab.drones[sysid], []
    say = drone.outgoing

    def outgoing(now_ns: int) -> list[bytes]:
        waiting.extend((now_ns + late_ms * MS, data) for data in say(now_ns))
        due = [data for due_ns, data in waiting if due_ns <= now_ns]
        if lab.seq % every:
            return []
        waiting[:] = [(due_ns, data) for due_ns, data in waiting if due_ns > now_ns]
        return due if every == 1 else due[-1:]

    drone.outgoing = outgoing


def test_the_backlog_of_a_link_is_a_measured_figure_by_timesyncs_clock_alone():
    lab = flying()
    assert lab.state.drones[1].link_behind_s < 0.01
    link = lab.core._links[2]
    assert link._made_ns(lab.now_ns + 9 * AHEAD_NS, lab.now_ns) is None  # of another clock
    assert 0.0 <= link.ages(lab.now_ns).behind_s < 0.01
    behind(lab, 2, 70)
    lab.run(1.3)
    assert abs(lab.state.drones[1].link_behind_s - 0.07) < 0.012
    assert ("rule-link-behind", "left") in lab.reported
    assert lab.phase is Phase.FORMATION


def test_one_late_message_before_a_pause_is_no_backlog():
    """A machine that stalls: each third of a second one message, 0.4 s old, and then nothing."""
    lab = flying()
    behind(lab, 2, 400, every=33)
    lab.run(2.0)
    assert not [code for code, _ in lab.reported if "link-behind" in code]


def test_a_swarm_holds_while_a_link_is_100_ms_behind_and_releases_its_drone_at_300():
    lab = flying()
    behind(lab, 2, 150)
    lab.run(1.0)
    assert lab.phase is Phase.HOLD
    behind(lab, 2, 250)
    lab.run(1.2)
    assert lab.phase is Phase.LAND
    assert commands(lab.drones[2], 21)
    assert not any(c.params[:2] == (0.0, 21196.0) for c in commands(lab.drones[2], 400))


def test_an_estimate_that_is_a_second_old_confirms_no_cut():
    """It was far outside by both, but by its own clock that was a second ago."""
    lab = flying()
    behind(lab, 3, 1000)
    lab.run(1.2)
    estimate = lab.core._links[3].own_estimate
    assert np.isnan([value for part in estimate.at(lab.now_ns) for value in np.atleast_1d(part)]).all()
