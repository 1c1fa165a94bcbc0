"""What the ground does on every fault, seen at the drones: GcsCore with fake drones that fail on demand."""

import struct
from dataclasses import replace

import numpy as np
import pytest

from formation.guidance.plan import Mode
from formation.messages import OperatorRequest, Phase, Verb
from formation.reasons import Reason
from gcs.alarms import EventMemory
from gcs.core import BrokenInvariantError
from tests.gcs.fakes import FakeLab, commands, flying, reasons, refusal, triangle
from wire.link_messages import EkfStatus, ExtendedSysState, LandedState, ParamType, ParamValue, Result


def test_a_body_is_nowhere_while_it_is_not_seen_and_nobody_arms():
    """It would stand at (0, 0, 0), where the drone `lead` is, and shoot from there to where it is first seen."""
    lab = FakeLab(triangle())
    lab.hidden.add("left")
    lab.drones[2].pos = np.array([1.5, 1.0, 0.0])
    lab.run(2.0)
    assert refusal(lab, Verb.ARM) == "left: no fresh pose (last seen never)"
    unknown = ("pos_lab_m", "q_lab_from_flu", "fence_margin_m", "error_m")
    assert {key: getattr(lab.state.drones[1], key) for key in unknown} == dict.fromkeys(unknown)
    lab.hidden.clear()
    lab.step()
    assert lab.state.drones[1].pos_lab_m == pytest.approx([1.5, 1.0, 0.0], abs=0.01)
    assert lab.state.prearm_failures == ()
    lab.hidden.add("left")
    lab.run(0.3)
    assert refusal(lab, Verb.ARM).startswith("left: no fresh pose (last seen 0.3")
    assert lab.state.drones[1].pos_lab_m is None
    lab.frames_stopped = True
    lab.run(0.5)
    assert reasons(lab, Verb.ARM).count(Reason.NO_POSE) == 3


def test_a_drone_that_rejects_arming_disarms_the_others_with_its_own_words():
    lab = FakeLab(triangle())
    lab.run(2.0)
    lab.drones[2].rejects_arming = True
    request = lab.ask(Verb.ARM)
    lab.run_until(Phase.ARMED)
    lab.run_until(Phase.GROUND, longest_s=4.0)
    reply = lab.reply(request)
    assert not reply.accepted
    assert lab.events.count("PreArm: no position") == 1
    assert reply.text == "left is not armed (denied; it says: PreArm: no position)"
    lab.run(3.0)
    assert [d.armed for d in lab.drones.values()] == [False] * 3


def test_requests_out_of_turn_are_rejected_with_the_phases_they_are_for():
    lab = FakeLab(triangle())
    lab.run(1.0)
    remedy = "`gcs arm`, then `gcs takeoff` begin a flight"
    assert refusal(lab, Verb.TAKEOFF) == f"takeoff is for ARMED, this is GROUND: {remedy}"
    alarms = EventMemory()
    for _, event in (record for record in lab.records if record[0] == "event"):
        alarms.note(event, 0)
    assert [event.text.partition(":")[0] for event in alarms.newest][-1:] == ["takeoff refused"]
    assert alarms.alarms.open == ()  # the asker has the reply, nobody else has to act
    assert reasons(lab, Verb.START) == [Reason.OUT_OF_TURN]
    assert reasons(lab, Verb.SHAPE) == [Reason.NO_SHAPE]
    lab.run(1.0)
    lab.ask(Verb.ARM)
    lab.run(0.5)
    assert reasons(lab, Verb.TAKEOFF) == [Reason.NOT_ARMED]
    assert reasons(lab, Verb.ARM) == [Reason.OUT_OF_TURN]


def test_a_follower_hidden_holds_the_swarm_then_lands_it_and_is_let_go():
    lab = flying()
    lab.hidden.update(("lead", "left", "right"))
    lab.run(0.05)  # a short dropout is flown through, by what is foreseen
    lab.hidden.clear()
    lab.run(1.0)
    assert lab.phase is Phase.FORMATION
    lab.hidden.add("left")
    setpoints = len(lab.drones[2].setpoints)
    lab.run(0.3)
    assert lab.phase is Phase.HOLD
    assert len(lab.drones[2].setpoints) == setpoints + 30
    lab.run(0.3)
    assert lab.phase is Phase.LAND
    setpoints = len(lab.drones[2].setpoints)
    lab.run(1.0)
    assert len(lab.drones[2].setpoints) == setpoints
    assert commands(lab.drones[2], 21)
    assert not commands(lab.drones[1], 21)
    lab.run_until(Phase.GROUND)
    assert [d.armed for d in lab.drones.values()] == [False] * 3


def test_an_observed_leader_hidden_holds_the_followers():
    lab = FakeLab(triangle(leader={"body": "lead"}))
    lab.fly()
    lab.run(2.0)
    lab.hidden.add("lead")
    lab.run(3.0)
    assert lab.phase is Phase.HOLD
    assert reasons(lab, Verb.START) == [Reason.LEADER_UNSEEN]


def test_mocap_gone_stops_setpoints_and_heartbeats_and_commands_every_drone_to_land():
    lab = flying()
    lab.frames_stopped = True
    lab.run(0.5)
    assert lab.phase is Phase.LAND
    assert all(commands(drone, 21) for drone in lab.drones.values())
    lab.run(5.0)
    assert [d.armed for d in lab.drones.values()] == [False] * 3
    assert lab.phase is Phase.GROUND


def test_a_drone_that_a_pilot_takes_over_is_not_fought_for():
    lab = flying()
    lab.drones[2].mode = 3 << 16
    modes = len(commands(lab.drones[2], 176))
    lab.run(2.0)
    assert lab.phase is Phase.LAND
    assert len(commands(lab.drones[2], 176)) == modes
    assert not commands(lab.drones[2], 21)
    led = [setpoint.mode is not Mode.IDLE for setpoint in lab.core._flight.plan().setpoints]
    assert led == [True, False, True]  # it goes its own way, and the others keep clear of that


def test_a_disarm_rejected_on_the_floor_is_forced():
    lab = flying()
    drone = lab.drones[1]
    obey = drone._obey
    drone._obey = lambda c: Result.DENIED if c.command == 400 and c.params[1] == 0.0 else obey(c)
    lab.land()
    assert any(c.params[:2] == (0.0, 21196.0) for c in commands(drone, 400))


def test_reset_leads_from_a_stop_to_another_flight():
    lab = flying()
    lab.command(Verb.STOP, Phase.STOPPED)
    assert "`gcs reset` leads back to GROUND" in refusal(lab, Verb.ARM)
    lab.run(2.0)
    assert lab.core.state(lab.now_ns).allowed["reset"] == ()
    lab.command(Verb.RESET, Phase.GROUND)
    lab.take_off()


def test_reset_is_rejected_while_a_drone_is_armed_or_unheard():
    lab = flying()
    lab.drones[1].receives_nothing = lab.drones[2].sends_nothing = True
    lab.command(Verb.STOP, Phase.STOPPED)
    lab.run(5.0)
    assert set(reasons(lab, Verb.RESET)) == {Reason.ARMED, Reason.MAY_BE_ARMED}
    assert lab.phase is Phase.STOPPED


def test_nothing_else_leaves_stopped():
    lab = flying()
    lab.command(Verb.STOP, Phase.STOPPED)
    for drone in lab.drones.values():
        drone.setpoints.clear()
    for verb in (Verb.ARM, Verb.TAKE_CONTROL, Verb.TAKEOFF, Verb.START, Verb.HOLD):
        assert reasons(lab, verb) == [Reason.OUT_OF_TURN]
    assert lab.reply(lab.ask(Verb.LAND)).accepted  # their motors are off, which ends every landing
    assert lab.phase is Phase.STOPPED
    lab.run(2.0)
    assert all(not drone.setpoints for drone in lab.drones.values())


def test_stop_on_the_ground_stops_too():
    lab = FakeLab(triangle())
    lab.command(Verb.STOP, Phase.STOPPED)
    lab.run(2.0)
    assert all(commands(drone, 400)[0].params[:2] == (0.0, 21196.0) for drone in lab.drones.values())


def test_a_duplicate_sysid_is_reported_and_keeps_the_swarm_on_the_ground():
    lab = FakeLab(triangle())
    twin = FakeLab(triangle()).drones[2]
    for _ in range(77):
        twin.codec.encode(EkfStatus(0, ardupilot=False))
    lab.run(2.0)
    for _ in range(300):
        lab.step()
        twin._say(ExtendedSysState(LandedState.ON_GROUND))
        lab.drones[2]._say(ExtendedSysState(LandedState.ON_GROUND))
        lab.drones[2]._out += twin.outgoing(lab.now_ns)
    assert ("rule-duplicate-sysid", "left") in lab.reported
    assert Reason.SYSID_TWICE in reasons(lab, Verb.ARM)


def test_an_estimate_that_is_not_finite_ends_the_core():
    lab = flying()
    lab.core._stack._memory.law["z_m"] = np.nan
    with pytest.raises(BrokenInvariantError, match="not finite"):
        lab.run(0.1)


def test_a_stop_cuts_the_motors_before_anything_that_may_fail():
    """With a frame and other requests that came before it, and a control that ends the core with that frame."""
    lab = flying()

    def broken(*_: object) -> None:
        raise BrokenInvariantError("not finite")

    lab.core._control = broken
    lab.now_ns += 10_000_000
    lab.core.receive(lab.frame(), lab.now_ns)
    for k, verb in enumerate((Verb.SHAPE, Verb.STOP)):
        lab.core.receive(OperatorRequest(900 + k, verb, "nonsense"), lab.now_ns)
    out = lab.core.tick(lab.now_ns)
    assert [(reply.id, reply.accepted) for reply in out.replies] == [(901, True)]
    for datagram in out.datagrams:
        lab.drones[datagram.sysid].receive(datagram.data, lab.now_ns)
    assert not any(drone.armed for drone in lab.drones.values())
    assert lab.core.next_deadline_ns() == lab.now_ns
    with pytest.raises(BrokenInvariantError, match="not finite"):
        lab.core.tick(lab.now_ns)


def test_a_rejection_code_that_is_none_of_ours_ends_nothing():
    """Such a frame is refused before it comes here; the state is published all the same."""
    lab = FakeLab(triangle())
    lab.run(1.0)
    lab.now_ns += 10_000_000
    frame = replace(lab.frame(), rejected=np.array([200, 0, 0], np.uint8))
    lab.core.receive(frame, lab.now_ns)
    lab._tick_while_due()
    assert lab.state.rejected == {"lead": "reason 200, of a later version"}


def test_a_forged_hover_thrust_changes_nothing_in_flight():
    """Led by a hover thrust of 0.1 or 0.4 it would be on the floor, or at 0.40 m, in phase HOLD."""
    lab, alone = flying(), flying()
    drone, link = lab.drones[2], lab.core._links[2]
    before = link.hover_thrust_norm
    for value in (0.1, 0.4, 0.9):
        drone._say(ParamValue("MPC_THR_HOVER", struct.pack("<f", value), ParamType.REAL32, 1, 0))
        lab.run(0.5)
        alone.run(0.5)
        assert link.hover_thrust_norm == before
    assert any("MPC_THR_HOVER announced anew while armed" in text for text in lab.events)
    assert np.array_equal(drone.pos, alone.drones[2].pos)


def test_the_formation_is_not_taken_up_outside_the_fence():
    lab = FakeLab(triangle(followers=[{"body": "left", "sysid": 2, "offset_m": (-2.0, 2.2, 0.0)}]))
    lab.drones[2].pos = np.array([-2.0, 1.5, 0.0])
    lab.run(2.0)
    lab.command(Verb.ARM, Phase.ARMED)
    lab.command(Verb.TAKEOFF, Phase.TAKEOFF)
    lab.run_until(Phase.HOLD)
    assert reasons(lab, Verb.START) == [Reason.SLOT_OUTSIDE]
