"""A link that falls behind: what is old is known to be old, acted on, and confirms nothing that cuts motors."""

import numpy as np

from formation.messages import Phase
from tests.gcs.fakes import AHEAD_NS, MS, FakeLab, triangle
from wire.link_messages.commands import CommandLong


def behind(lab: FakeLab, sysid: int, late_ms: int) -> None:
    """From now on what that drone says of its motion arrives so late, as out of a queue that is full."""
    drone, waiting = lab.drones[sysid], []
    say = drone.outgoing

    def outgoing(now_ns: int) -> list[bytes]:
        waiting.extend((now_ns + late_ms * MS, data) for data in say(now_ns))
        due = [data for due_ns, data in waiting if due_ns <= now_ns]
        waiting[:] = [(due_ns, data) for due_ns, data in waiting if due_ns > now_ns]
        return due

    drone.outgoing = outgoing


def flying(**changes) -> FakeLab:
    lab = FakeLab(triangle(**changes))
    lab.fly()
    lab.run(0.5)
    return lab


def drone_state(lab: FakeLab, sysid: int):
    return next(d for d in lab.core.state(lab.now_ns)["drones"] if d["sysid"] == sysid)


def test_the_backlog_of_a_link_is_a_measured_figure():
    lab = flying()
    assert drone_state(lab, 2)["link_behind_s"] < 0.01
    behind(lab, 2, 70)
    lab.run(1.3)
    assert abs(drone_state(lab, 2)["link_behind_s"] - 0.07) < 0.012
    assert "left: its telemetry arrives 50 ms late" in lab.events
    assert lab.phase is Phase.FORMATION


def test_a_swarm_holds_while_a_link_is_100_ms_behind_and_releases_its_drone_at_300():
    lab = flying()
    behind(lab, 2, 150)
    lab.run(1.0)
    assert lab.phase is Phase.HOLD
    behind(lab, 2, 250)
    lab.run(1.2)
    assert lab.phase is Phase.LAND
    commands = [m for m in lab.drones[2].heard if isinstance(m, CommandLong)]
    assert any(m.command == 21 for m in commands)
    assert not any(m.command == 400 and m.params[:2] == (0.0, 21196.0) for m in commands)


def test_an_estimate_that_is_a_second_old_confirms_no_cut():
    """It was far outside by both, but by its own clock that was a second ago."""
    lab = flying()
    behind(lab, 3, 1000)
    lab.run(1.2)
    link = next(d.link for d in lab.core._drones if d.link.sysid == 3)
    assert np.isnan(link.own_estimate.pos_lab_m(lab.now_ns)).all()
    assert np.isnan(link.own_estimate.tilt_rad(lab.now_ns))


def test_poses_and_estimate_that_come_by_one_link_are_one_witness():
    """Where autopilots are their own mocap, both would be wrong together: the drone is released, never cut."""
    lab = FakeLab(triangle(mocap={"source": "mavlink"}))
    lab.fly()
    lab.run(0.5)
    lab.drones[3].pos = np.array([3.2, -1.0, 0.3])
    lab.run(0.6)
    assert "right: 0.5 m outside the fence" in lab.events
    assert lab.phase is Phase.LAND
    commands = [m for m in lab.drones[3].heard if isinstance(m, CommandLong)]
    assert any(m.command == 21 for m in commands)
    assert not any(m.command == 400 and m.params[:2] == (0.0, 21196.0) for m in commands)


def test_stamps_of_another_clock_than_timesyncs_say_nothing_of_age():
    lab = FakeLab(triangle())
    lab.run(2.0)
    link = next(d.link for d in lab.core._drones if d.link.sysid == 2)
    assert 0.0 <= link.behind_s(lab.now_ns) < 0.01
    assert link._made_ns(lab.now_ns + 9 * AHEAD_NS, lab.now_ns) is None
    assert 0.0 <= link.behind_s(lab.now_ns) < 0.01


def test_one_late_message_before_a_pause_is_no_backlog():
    """A machine that stalls: each third of a second one message, 0.4 s old, and then nothing."""
    lab = flying()
    drone = lab.drones[2]
    say, waiting = drone.outgoing, []

    def outgoing(now_ns: int) -> list[bytes]:
        waiting.extend((now_ns + 400 * MS, data) for data in say(now_ns))
        due = [data for due_ns, data in waiting if due_ns <= now_ns]
        if not due or lab.seq % 33:
            return []
        waiting[:] = [(due_ns, data) for due_ns, data in waiting if due_ns > now_ns]
        return due[-1:]

    drone.outgoing = outgoing
    lab.run(2.0)
    assert not [text for text in lab.events if "arrives" in text]
