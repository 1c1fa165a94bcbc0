"""Two cores joined by a function: GcsCore with fake drones, through whole flights."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from formation.messages import Phase, Rejection, Verb
from tests.gcs.fakes import MS, T0_NS, FakeLab, triangle
from wire.link_messages import Address, AttitudeSetpoint, CommandLong, Heartbeat, TimeSync, VisionPose


@pytest.fixture
def lab() -> FakeLab:
    return FakeLab(triangle())


def test_a_whole_flight(lab):
    lab.fly()
    assert [d.armed for d in lab.drones.values()] == [True] * 3
    lab.run(7.0)
    assert lab.state.trajectory_done
    assert np.allclose(lab.drones[1].pos, [1.0, 0.0, 0.3], atol=0.05)
    assert np.allclose(lab.drones[2].pos - lab.drones[1].pos, [-0.4, 0.4, 0.0], atol=0.05)
    assert np.allclose(lab.drones[3].pos - lab.drones[1].pos, [-0.4, -0.4, 0.0], atol=0.05)
    lab.command(Verb.HOLD, Phase.HOLD)
    lab.land()
    lab.command(Verb.ARM, Phase.ARMED)  # and again
    phases = [message.phase for name, message in lab.records if name == "phase"]
    assert phases == [
        Phase.GROUND, Phase.ARMED, Phase.TAKEOFF, Phase.HOLD, Phase.FORMATION, Phase.HOLD, Phase.LAND, Phase.GROUND,
        Phase.ARMED,
    ]  # fmt: skip


def test_px4_gets_a_second_of_setpoints_before_the_mode_and_the_mode_before_arming(lab):
    lab.run(2.0)
    asked_ns = lab.now_ns
    lab.ask(Verb.ARM)
    lab.run_until(Phase.ARMED)
    lab.run(4.0)
    drone = lab.drones[2]
    first_ns = drone.setpoints[0][0]
    assert first_ns - asked_ns <= 10 * MS
    assert all(setpoint.thrust_norm == 0.0 for _, setpoint in drone.setpoints)
    kinds = [m for m in drone.heard if isinstance(m, CommandLong) and m.command in (176, 400)]
    assert [(c.command, c.params[:2]) for c in kinds] == [(176, (1.0, 6.0)), (400, (1.0, 0.0))]
    before_mode = drone.heard[: drone.heard.index(kinds[0])]
    assert sum(isinstance(m, AttitudeSetpoint) for m in before_mode) >= 100
    assert lab.reply(1).accepted


def test_every_setpoint_rides_on_a_frame_and_names_its_capture(lab):
    lab.fly()
    lab.run(0.5)
    for setpoint_ns, setpoint in lab.drones[1].setpoints[-20:]:
        assert setpoint.t_boot_ms == (setpoint_ns - 5 * MS) // MS
        assert setpoint.target == Address(1, 1)
    spacing = {b - a for (a, _), (b, _) in itertools.pairwise(lab.drones[1].setpoints[-20:])}
    assert spacing == {10 * MS}


def test_the_heartbeat_is_earned_by_frames(lab):
    lab.run(3.0)
    assert lab.core.next_deadline_ns() - lab.now_ns == 30 * MS
    drone = lab.drones[1]
    drone.heard.clear()
    lab.run(3.0)
    assert sum(isinstance(m, Heartbeat) for m in drone.heard) == 3
    drone.heard.clear()
    lab.frames_stopped = True
    ticks = len(lab.ticks)
    lab.run(5.0)
    assert 150 <= len(lab.ticks) - ticks <= 300  # the watchdog's
    assert not any(isinstance(m, Heartbeat | AttitudeSetpoint | VisionPose) for m in drone.heard)
    assert any(isinstance(m, TimeSync) for m in drone.heard)


def test_of_two_frames_the_newest_is_flown_and_one_that_goes_back_is_dropped_both_counted(lab):
    lab.fly()
    lab.run(0.5)
    before = lab.state.counters
    for _ in range(2):
        lab.seq += 1
        lab.now_ns += 10 * MS
        lab.core.receive(lab.frame(), lab.now_ns)
    lab.step()
    assert lab.state.counters.missed_frames == before.missed_frames + 2
    lab.core.receive(replace(lab.frame(), t_capture_ns=T0_NS), lab.now_ns)
    assert lab.core.next_deadline_ns() > lab.now_ns
    assert lab.state.counters.stale_frames == before.stale_frames + 1


def test_an_observed_leader_is_followed_and_never_commanded():
    lab = FakeLab(triangle(leader={"body": "lead"}))
    lab.leader_pos = np.array([0.2, 0.0, 0.3])
    assert set(lab.drones) == {2, 3}
    lab.fly()
    for i in range(300):
        lab.leader_pos = np.array([0.2 + 0.001 * i, 0.0, 0.3])
        lab.step()
    lab.run(1.0)
    assert np.allclose(lab.drones[2].pos - lab.leader_pos, [-0.4, 0.4, 0.0], atol=0.03)


def test_status_says_of_whom_the_mocap_rejects_the_pose_and_why(lab):
    lab.run(0.5)
    lab.seq, lab.now_ns = lab.seq + 1, lab.now_ns + 10 * MS
    codes = np.array([0, Rejection.JUMP, 0], np.uint8)
    lab.core.receive(replace(lab.frame(), seen=codes == 0, rejected=codes), lab.now_ns)
    status = lab.state
    assert status.rejected == {"left": "jumped farther than it can move"}
    assert [drone.rejected for drone in status.drones] == [None, "jumped farther than it can move", None]
    lab.step()
    assert lab.state.rejected == {}


def test_the_floor_is_no_wall_for_a_drone_that_stands(lab):
    lab.run(2.0)
    low, high = lab.config.limits.fence.low_m, lab.config.limits.fence.high_m
    for drone in lab.core.state(lab.now_ns).drones:
        x, y, z = drone.pos_lab_m
        walls = (x - low[0], y - low[1], high[0] - x, high[1] - y, high[2] - z)
        assert drone.fence_margin_m == pytest.approx(min(walls), abs=2e-3)
    lab.fly()
    z_low = [d.pos_lab_m[2] - low[2] for d in lab.core.state(lab.now_ns).drones]
    margins = [d.fence_margin_m for d in lab.core.state(lab.now_ns).drones]
    assert all(margin <= below + 2e-3 for margin, below in zip(margins, z_low, strict=True))
