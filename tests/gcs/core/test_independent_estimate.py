"""Motors are cut where two independent estimates agree, a pilot is left alone, and a landing ends."""

import itertools

import numpy as np
import pytest

from formation.messages import Cause, EventCode, Phase, Verb
from gcs.core import GcsCore
from gcs.safety import MONITORS
from tests.gcs.fakes import MS, FakeLab, commands, flying, triangle
from wire.link_messages import CommandLong, NamedValue, Result

UPSIDE_DOWN = np.array([0.0, 1.0, 0.0, 0.0])
POSCTL = 3 << 16
CUT = (0.0, 21196.0)


def parameters(drone, number: int) -> list[tuple[float, ...]]:
    return [command.params[:2] for command in commands(drone, number)]


def lying_mocap(lab: FakeLab, body: str, pos=None, q=None) -> None:
    """From now on the mocap has that body elsewhere, or turned."""
    true = lab.frame

    def frame():
        seen = true()
        k = seen.bodies.index(body)
        if pos is not None:
            seen.pos_lab_m[k] = pos
        if q is not None:
            seen.q_lab_from_flu[k] = q
        return seen

    lab.frame = frame


@pytest.mark.parametrize(
    ("lie", "alarm"),
    [
        ({"q": UPSIDE_DOWN}, "left: tilted by 75 degrees"),
        ({"pos": (3.2, 1.0, 0.3)}, "left: 0.5 m outside the fence"),
    ],
)
def test_what_only_the_mocap_sees_cuts_no_motor(lie, alarm):
    lab = flying()
    lying_mocap(lab, "left", **lie)
    lab.run(0.6)
    assert lab.phase is Phase.LAND
    assert alarm in lab.events
    lab.run(5.0)
    assert CUT not in parameters(lab.drones[2], 400)
    assert parameters(lab.drones[2], 21)
    assert not lab.drones[2].armed


def test_an_attitude_that_both_see_upside_down_cuts():
    lab = flying()
    lying_mocap(lab, "left", q=UPSIDE_DOWN)
    lab.drones[2].own_q = UPSIDE_DOWN
    lab.run(0.5)
    assert ("rule-tilted-agreed", "left") in lab.reported
    assert not lab.drones[2].armed


def test_a_drone_far_outside_by_both_is_cut_wherever_its_own_origin_is_and_the_others_land():
    lab = FakeLab(triangle())
    lab.drones[3].own_shift = np.array([5.0, -7.0, 0.2])
    lab.fly()
    lab.drones[3].pos = np.array([3.2, -1.0, 0.3])
    lab.run(0.4)
    assert ("rule-far-outside-agreed", "right") in lab.reported
    assert parameters(lab.drones[3], 400)[-1] == CUT
    assert not lab.drones[3].armed
    assert lab.phase is Phase.LAND
    assert lab.drones[1].armed


def test_a_pilot_who_holds_it_at_a_metre_keeps_his_motors():
    """It is at rest while the landing leads it to the floor, which counted as touched down."""
    lab = flying(flight={"altitude_m": 1.0})
    drone = lab.drones[2]
    lab.command(Verb.LAND, Phase.LAND)
    drone.mode = POSCTL
    lab.run(10.0)
    assert drone.armed
    assert drone.pos[2] > 0.8
    assert not parameters(drone, 21)
    assert [c for c in parameters(drone, 400) if c[0] == 0.0] == []
    assert lab.reported.count((EventCode.PILOT, "left")) == 1
    assert lab.phase is Phase.GROUND
    assert lab.causes[-1] is Cause.LEFT_TO_PILOT
    reply = lab.reply(lab.ask(Verb.ARM))
    assert "left: armed, in POSCTL" in reply.text
    lab.command(Verb.STOP, Phase.STOPPED)
    lab.run(0.1)
    assert not drone.armed


@pytest.mark.parametrize("how", ["receives_nothing", "sends_nothing", "rejecting", "following nothing"])
def test_a_landing_ends_with_its_cause_whatever_a_drone_does(how):
    lab = flying(flight={"altitude_m": 1.0})
    drone, react = lab.drones[2], lab.drones[2]._react
    height_m = float(drone.pos[2])
    lab.command(Verb.LAND, Phase.LAND)
    began_ns = lab.now_ns
    if how == "rejecting":
        drone._obey = lambda _command: Result.DENIED
    elif how == "following nothing":
        drone._react = lambda m, now: react(m, now) if isinstance(m, CommandLong) else None
    else:
        setattr(drone, how, True)
        drone.receives_nothing = True
    lab.run_until(Phase.GROUND, longest_s=height_m / 0.3 + 10.1)
    assert (lab.now_ns - began_ns) * 1e-9 <= height_m / 0.3 + 10.05
    if how == "receives_nothing":
        assert any(e.startswith("the landing has taken too long: left is still armed, in OFFBOARD") for e in lab.events)
    if how == "following nothing":
        assert parameters(drone, 21)
        assert not drone.armed
    assert not lab.drones[1].armed


def test_a_disarm_that_is_rejected_in_the_air_is_never_forced():
    """Its own landed state and a mode that is not ours: nothing bears out that it is on the floor."""
    lab = FakeLab(triangle())
    lab.run(2.0)
    lab.command(Verb.ARM, Phase.ARMED)
    drone = lab.drones[2]
    drone.mode, drone.pos = POSCTL, np.array([-0.4, 0.4, 0.8])
    lab.run_until(Phase.GROUND)
    lab.run(8.0)
    assert drone.armed
    assert CUT not in parameters(drone, 400)


def test_every_packet_is_a_sign_of_life():
    lab = flying()
    lab.drones[3]._beat_ns = 2**62  # not one heartbeat more
    lab.run(6.0)
    assert lab.phase is Phase.FORMATION
    lab.drones[3].sends_nothing = True
    lab.run(3.1)
    assert lab.phase is Phase.LAND
    assert ("rule-silent", "right") in lab.reported


def test_setpoints_that_come_late_are_warned_of_then_the_drone_is_let_go():
    lab = flying()
    for _ in range(20):
        lab.drones[2]._say(NamedValue(0, "age_ms", 85.0))
        lab.run(0.1)
    assert ("rule-setpoints-late", "left") in lab.reported
    assert lab.phase is Phase.FORMATION
    for _ in range(12):
        lab.drones[2]._say(NamedValue(0, "age_ms", 140.0))
        lab.run(0.1)
    assert lab.phase is Phase.LAND
    assert parameters(lab.drones[2], 21)
    assert not parameters(lab.drones[1], 21)


def test_a_stop_is_repeated_every_ten_milliseconds_without_any_frame_until_it_is_confirmed():
    lab = flying()
    lab.drones[2].receives_nothing = True
    sent: list[int] = []
    lab.core.receive(lab.frame(), lab.now_ns)
    lab.ask(Verb.STOP)
    for _ in range(100):
        due_ns = lab.core.next_deadline_ns()
        lab.now_ns = max(due_ns, lab.now_ns)
        out = lab.core.tick(lab.now_ns)
        sent += [lab.now_ns for d in out.datagrams if d.sysid == 2]
    spacing = {b - a for a, b in itertools.pairwise(sent)}
    assert spacing == {10 * MS}
    assert [drone.armed for drone in lab.drones.values()] == [False, True, False]
    lab.drones[2].receives_nothing = False
    lab.run(0.02)
    assert not lab.drones[2].armed
    lab.run(1.5)
    assert lab.core.next_deadline_ns() - lab.now_ns == 30 * MS


def test_monitors_are_switched_off_by_name():
    assert len(set(MONITORS)) == len(MONITORS)
    lab = FakeLab(triangle())
    lab.core = GcsCore(lab.config, lab.now_ns, without=frozenset({"rule-unseen", "rule-lost"}))
    lab.fly()
    lab.hidden.add("left")
    lab.run(1.0)
    assert lab.phase is Phase.FORMATION
