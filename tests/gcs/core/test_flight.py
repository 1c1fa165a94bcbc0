"""Two cores joined by a function: GcsCore with fake drones, through whole flights."""

import itertools
import json
from dataclasses import replace

import numpy as np
import pytest

from formation.messages import LabFrame, Phase, Verb
from formation.rejection import Rejection
from tests.gcs.fakes import MS, T0_NS, FakeLab, triangle
from wire.link_messages.address import Address
from wire.link_messages.clocks import TimeSync
from wire.link_messages.commands import CommandLong
from wire.link_messages.motion import VisionPose
from wire.link_messages.setpoints import AttitudeSetpoint
from wire.link_messages.status import Heartbeat, MavAutopilot


@pytest.fixture
def lab() -> FakeLab:
    return FakeLab(triangle())


def test_a_whole_flight(lab):
    lab.fly()
    assert [d.armed for d in lab.drones.values()] == [True] * 3
    lab.run(7.0)
    assert json.loads(lab.core.status(lab.now_ns))["trajectory_done"]
    assert np.allclose(lab.drones[1].pos, [1.0, 0.0, 0.3], atol=0.05)
    assert np.allclose(lab.drones[2].pos - lab.drones[1].pos, [-0.4, 0.4, 0.0], atol=0.05)
    assert np.allclose(lab.drones[3].pos - lab.drones[1].pos, [-0.4, -0.4, 0.0], atol=0.05)
    lab.command(Verb.HOLD, Phase.HOLD)
    lab.command(Verb.LAND, Phase.LAND)
    lab.run_until(Phase.GROUND)
    assert [d.armed for d in lab.drones.values()] == [False] * 3
    phases = [message.phase for name, message in lab.records if name == "phase"]
    assert phases == [
        Phase.GROUND, Phase.ARMED, Phase.TAKEOFF, Phase.HOLD, Phase.FORMATION, Phase.HOLD, Phase.LAND, Phase.GROUND,
    ]  # fmt: skip


def test_it_flies_again_after_landing(lab):
    for _ in range(2):
        lab.run(1.0)
        lab.command(Verb.ARM, Phase.ARMED)
        lab.command(Verb.TAKEOFF, Phase.TAKEOFF)
        lab.run_until(Phase.HOLD)
        lab.command(Verb.LAND, Phase.LAND)
        lab.run_until(Phase.GROUND)


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


def test_a_mixed_fleet_is_brought_to_its_own_modes():
    lab = FakeLab(triangle(), {2: MavAutopilot.ARDUPILOT})
    lab.fly()
    assert lab.drones[2].mode == 4
    assert lab.drones[3].mode == 6 << 16


def test_lost_commands_are_repeated(lab):
    lab.run(2.0)
    lab.drones[3].ignore_first = 3
    lab.command(Verb.ARM, Phase.ARMED)
    confirmations = [m.confirmation for m in lab.drones[3].heard if isinstance(m, CommandLong) and m.command == 176]
    assert confirmations == [0, 1, 2, 3]


def test_every_setpoint_rides_on_a_frame_and_names_its_capture(lab):
    lab.fly()
    lab.run(0.5)
    for setpoint_ns, setpoint in lab.drones[1].setpoints[-20:]:
        assert setpoint.t_boot_ms == (setpoint_ns - 5 * MS) // MS
        assert setpoint.target == Address(1, 1)
    spacing = {b - a for (a, _), (b, _) in itertools.pairwise(lab.drones[1].setpoints[-20:])}
    assert spacing == {10 * MS}


def test_poses_go_to_each_drone_at_fifty_hertz_even_on_the_ground(lab):
    lab.run(3.0)
    lab.drones[2].heard.clear()
    lab.run(2.0)
    poses = [m for m in lab.drones[2].heard if isinstance(m, VisionPose)]
    assert 99 <= len(poses) <= 101
    assert all(np.allclose(m.pos_lab_m, [-0.4, 0.4, 0.0], atol=1e-3) for m in poses)


def test_the_heartbeat_is_earned_by_frames(lab):
    lab.run(3.0)
    drone = lab.drones[1]
    drone.heard.clear()
    lab.run(3.0)
    assert sum(isinstance(m, Heartbeat) for m in drone.heard) == 3
    drone.heard.clear()
    lab.frames_stopped = True
    lab.run(5.0)
    assert not any(isinstance(m, Heartbeat | AttitudeSetpoint | VisionPose) for m in drone.heard)
    assert any(isinstance(m, TimeSync) for m in drone.heard)


def test_without_frames_the_watchdog_ticks(lab):
    lab.run(1.0)
    lab.frames_stopped = True
    ticks = len(lab.ticks)
    lab.run(1.0)
    assert 30 <= len(lab.ticks) - ticks <= 60


def test_the_core_wants_no_tick_before_it_is_due(lab):
    lab.run(0.5)
    assert lab.core.next_deadline_ns() - lab.now_ns == 30 * MS


def test_of_two_frames_the_newest_is_flown_and_the_other_counted(lab):
    lab.fly()
    lab.run(0.5)
    before = json.loads(lab.core.status(lab.now_ns))["counters"]["missed_frames"]
    for _ in range(2):
        lab.seq += 1
        lab.now_ns += 10 * MS
        lab.core.receive(lab.frame(), lab.now_ns)
    lab.step()
    assert json.loads(lab.core.status(lab.now_ns))["counters"]["missed_frames"] == before + 2


def test_frames_that_go_back_are_dropped_and_counted(lab):
    lab.run(0.5)
    frame = lab.frame()
    old = LabFrame(frame.seq, T0_NS, frame.bodies, frame.pos_lab_m, frame.q_lab_from_flu, frame.seen)
    lab.core.receive(old, lab.now_ns)
    assert lab.core.next_deadline_ns() > lab.now_ns
    assert json.loads(lab.core.status(lab.now_ns))["counters"]["stale_frames"] == 1


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


def test_status_is_strict_json_from_the_first_moment_on(lab):
    def strict(text: str) -> dict:
        return json.loads(text, parse_constant=pytest.fail)

    status = strict(lab.core.status(lab.now_ns))
    assert status["phase"] == "GROUND"
    assert status["drones"][0]["age_s"] is None
    assert "left: no heartbeat (last heard never)" in status["refusals"]
    lab.run(2.0)
    status = strict(lab.core.status(lab.now_ns))
    assert status["refusals"] == []
    assert [d["sysid"] for d in status["drones"]] == [1, 2, 3]


def test_status_says_of_whom_the_mocap_rejects_the_pose_and_why(lab):
    lab.run(0.5)
    lab.seq, lab.now_ns = lab.seq + 1, lab.now_ns + 10 * MS
    codes = np.array([0, Rejection.JUMP, 0], np.uint8)
    lab.core.receive(replace(lab.frame(), seen=codes == 0, rejected=codes), lab.now_ns)
    status = json.loads(lab.core.status(lab.now_ns))
    assert status["rejected"] == {"left": "jumped farther than it can move"}
    assert [drone["rejected"] for drone in status["drones"]] == [None, "jumped farther than it can move", None]
    lab.step()
    assert json.loads(lab.core.status(lab.now_ns))["rejected"] == {}


@pytest.mark.parametrize(
    ("trajectory", "lasts_s"),
    [
        ({"kind": "circle", "radius_m": 0.1, "period_s": 2.0, "laps": 1}, 2.5),
        ({"kind": "waypoints", "waypoints_m": [(0.5, 0.0, 0.3)], "speed_m_s": 0.5}, 1.875),
    ],
)
def test_a_trajectory_is_done_when_it_has_been_flown(trajectory, lasts_s) -> None:
    lab = FakeLab(triangle(leader={"body": "lead", "sysid": 1, "trajectory": trajectory}))
    lab.fly()

    def status(key: str) -> bool:
        return bool(json.loads(lab.core.status(lab.now_ns))[key])

    while not status("trajectory_started"):
        lab.step()
    lab.run(lasts_s - 0.1)
    assert not status("trajectory_done")
    lab.run(0.2)
    assert status("trajectory_done")


def test_a_body_that_is_not_seen_has_no_position_in_the_state(lab):
    lab.run(2.0)
    assert lab.core.state(lab.now_ns)["drones"][1]["pos_lab_m"] is not None
    lab.hidden.add(lab.core.state(lab.now_ns)["drones"][1]["body"])
    lab.run(1.0)
    state = lab.core.state(lab.now_ns)["drones"][1]
    unknown = ("pos_lab_m", "q_lab_from_flu", "fence_margin_m", "error_m")
    assert {key: state[key] for key in unknown} == dict.fromkeys(unknown)
    assert state["age_s"] == pytest.approx(1.0, abs=0.05)


def test_the_floor_is_no_wall_for_a_drone_that_stands(lab):
    lab.run(2.0)
    low, high = lab.config.limits.fence.low_m, lab.config.limits.fence.high_m
    for drone in lab.core.state(lab.now_ns)["drones"]:
        x, y, z = drone["pos_lab_m"]
        walls = (x - low[0], y - low[1], high[0] - x, high[1] - y, high[2] - z)
        assert drone["fence_margin_m"] == pytest.approx(min(walls), abs=2e-3)
    lab.fly()
    z_low = [d["pos_lab_m"][2] - low[2] for d in lab.core.state(lab.now_ns)["drones"]]
    margins = [d["fence_margin_m"] for d in lab.core.state(lab.now_ns)["drones"]]
    assert all(margin <= below + 2e-3 for margin, below in zip(margins, z_low, strict=True))
