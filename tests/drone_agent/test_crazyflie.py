"""A Crazyflie behind its bridge's upper half, without sockets: what it is sent, and what is made of what it says."""

import math

import numpy as np
import pytest

from drone_agent.autopilots.model import Task
from drone_agent.crazyflie.core import CrazyflieConfig, CrazyflieCore
from drone_agent.flight.vehicle import ExternalPose
from drone_agent.guard.position import LoopSetpoint
from formation.maths.frames import from_euler
from tests.drone_agent.crazyflie_peer import Peer
from wire.crtp import Supervisor
from wire.link_messages import Result

MS = 1_000_000
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


class Rig:
    """The upper half and a peer, joined by calls, a step a millisecond."""

    def __init__(self, peer: Peer | None = None) -> None:
        self.peer = peer or Peer()
        self.core = CrazyflieCore(CrazyflieConfig(bridge="udp://127.0.0.1:19850"), 0)
        self.cf, self.now_ms = self.core.crazyflie, 0
        self.heard: list[str] = []
        self.is_lost = False

    def run(self, ms: int, pose_lab_m: tuple[float, float, float] | None = (0.0, 0.0, 0.0)) -> "Rig":
        for _ in range(ms):
            self.now_ms += 1
            now_ns = self.now_ms * MS
            if pose_lab_m is not None and self.now_ms % 20 == 0:
                self.core._use_pose(ExternalPose(now_ns, np.array(pose_lab_m), LEVEL.copy()), now_ns)
            if not self.is_lost:
                for packet in self.peer.logged(self.now_ms):
                    self.core.receive_packet(packet, now_ns)
            self.heard += [event.text for event in self.core.turn(now_ns).events]
            for packet in self.core.pop_packets():
                if not self.is_lost:
                    for reply in self.peer.receive(packet):
                        self.core.receive_packet(reply, now_ns)
        return self

    def arm(self) -> "Rig":
        assert self.core.autopilot.arm(self.now_ms * MS) is Result.ACCEPTED
        return self.run(100)


@pytest.fixture
def rig() -> Rig:
    return Rig().run(2500)


def test_connects_reads_its_parameters_and_sets_what_setpoints_need(rig: Rig) -> None:
    assert rig.cf.connection is not None
    assert rig.peer.parameters["flightmode.stabModeYaw"][2] == 1
    assert rig.core.parameters["CF_POS_STD"] == 0.25
    assert math.isnan(rig.core.parameters["CF_CONTROLLER"])  # this firmware has none: nobody makes one up
    assert rig.core.parameters.message("CF_CONTROLLER") is None


def test_writes_on_what_is_set_by_mavlink(rig: Rig) -> None:
    rig.core.parameters.set("CF_POS_STD", 0.01)
    rig.run(100)
    assert rig.peer.parameters["locSrv.extPosStdDev"][2] == pytest.approx(0.01)


def test_poses_reach_its_estimator(rig: Rig) -> None:
    rig.run(100, (0.05, 0.0, 0.0))
    assert rig.peer.poses[-1] == pytest.approx((0.05, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("roll", "pitch", "yaw"), [(0.2, 0.0, 0.0), (0.0, 0.2, 0.0), (0.1, -0.2, 0.0), (0.0, 0.0, 1.0)]
)
def test_a_setpoint_is_its_tilt_its_yaw_and_its_thrust(rig: Rig, roll: float, pitch: float, yaw: float) -> None:
    rig.arm()
    rig.cf.order_now(LoopSetpoint(from_euler(np.array(roll), np.array(pitch), np.array(yaw)), np.zeros(3), 0.5))
    sent = rig.core.pop_packets()[-1]
    rig.peer.receive(sent)
    wire = np.degrees([roll, -pitch, yaw])  # the wire's pitch is nose up
    assert rig.peer.setpoints[-1] == pytest.approx((*wire, 32768), abs=0.3)


def test_a_firmware_without_absolute_yaw_is_turned_by_rate_within_the_profiles_limit() -> None:
    rig = Rig(Peer("flightmode.stabModeYaw")).run(2500).arm()
    rig.cf.order_now(LoopSetpoint(from_euler(np.array(0.0), np.array(0.0), np.array(2.0)), np.zeros(3), 0.5))
    rig.peer.receive(rig.core.pop_packets()[-1])
    assert rig.peer.setpoints[-1][2] == pytest.approx(-math.degrees(3.5))  # its legacy rate turns right


def test_arms_by_its_supervisor_and_unlocks_its_thrust(rig: Rig) -> None:
    assert not rig.peer.setpoints  # nothing feeds its watchdog while it is disarmed
    rig.arm()
    assert rig.peer.info & Supervisor.IS_ARMED
    assert rig.peer.setpoints[0] == (0.0, 0.0, 0.0, 0)
    rig.core.autopilot.disarm(force=False, reason="test")
    rig.run(100)
    assert not rig.peer.info & Supervisor.IS_ARMED
    assert not rig.peer.stops  # it stands: no emergency, and no restart


def test_a_stop_in_flight_is_repeated_until_it_says_that_it_is_locked(rig: Rig) -> None:
    rig.arm()
    rig.core.autopilot.detector.landed = False
    rig.core.autopilot.disarm(force=True, reason="stop")
    rig.run(1)
    assert rig.peer.stops == 1
    rig.run(200)
    assert rig.peer.stops > 5
    rig.peer.info = Supervisor.IS_LOCKED
    rig.run(40)
    stops = rig.peer.stops
    rig.run(200)
    assert rig.peer.stops == stops
    assert "locked" in (rig.cf.fault(rig.now_ms * MS) or "")


@pytest.mark.parametrize(("info", "text"), [(Supervisor.IS_TUMBLED, "tumbled"), (Supervisor.IS_CRASHED, "crashed")])
def test_what_its_supervisor_says_disarms_and_forbids_arming(rig: Rig, info: Supervisor, text: str) -> None:
    rig.arm()
    rig.peer.info = info
    rig.run(100)
    assert not rig.core.autopilot.armed
    assert text in (rig.cf.fault(rig.now_ms * MS) or "")
    assert rig.core.autopilot.arm(rig.now_ms * MS) is not Result.ACCEPTED


def test_does_not_arm_where_its_estimate_is_not_where_the_mocap_sees_it(rig: Rig) -> None:
    rig.run(1500, (0.5, 0.0, 0.0))
    assert rig.cf.fault(rig.now_ms * MS) == "its estimate is not where the mocap sees it"


def test_a_silence_is_reported_once_and_a_longer_one_connects_anew(rig: Rig) -> None:
    rig.is_lost = True
    rig.run(1000)
    assert sum("silent" in text for text in rig.heard) == 1
    assert rig.cf.fault(rig.now_ms * MS) == "the Crazyflie does not answer"
    rig.run(1500)
    rig.is_lost = False
    rig.run(3000)
    assert rig.cf.fault(rig.now_ms * MS) is None


def test_a_sample_has_the_time_at_which_it_was_taken_by_a_clock_that_loses_ticks(rig: Rig) -> None:
    assert rig.cf.connection is not None
    (block,) = (number for number, each in rig.cf.connection.blocks.items() if "acc.z" in each.names)
    data = next(p for p in rig.peer.logged(100) if p[1] == block)
    for number in range(1, 300):
        now_ns = (rig.now_ms + 10 * number) * MS
        lost_ms = number // 25 * 10  # 4 %
        stamp_ms = rig.now_ms + 10 * number - lost_ms
        rig.core.receive_packet(data[:2] + stamp_ms.to_bytes(3, "little") + data[5:], now_ns)
        if number % 25 > 12:
            assert 0 <= now_ns - rig.cf.t_ns < MS


@pytest.mark.parametrize(("volts", "remaining"), [(4.2, 1.0), (3.82, 0.5), (3.3, 0.0)])
def test_its_battery_is_its_voltage_at_rest(rig: Rig, volts: float, remaining: float) -> None:
    rig.peer.values["pm.vbat"] = volts
    rig.run(200)
    assert rig.cf.pack.remaining == pytest.approx(remaining, abs=0.01)
    rig.peer.values["pm.state"] = 3.0  # its own word counts more
    rig.run(200)
    assert rig.cf.pack.remaining == 0.0


def test_a_battery_that_it_does_not_measure_is_not_made_up() -> None:
    rig = Rig(Peer("pm.vbat", "pm.state")).run(2500)
    assert math.isnan(rig.cf.pack.remaining)
    assert any("it has no pm.vbat, pm.state" in text for text in rig.heard)


def test_packets_that_are_lost_are_counted_and_those_sent_again_by_its_radio(rig: Rig) -> None:
    assert rig.cf.link_loss == 0.0
    for k in range(200):
        rig.is_lost = k % 4 == 0
        rig.run(10)
    rig.is_lost = False
    assert rig.cf.link_loss == pytest.approx(0.25, abs=0.03)
    rig.cf.sent_again = 0.5
    assert rig.cf.link_loss == 0.5
    rig.is_lost = True
    rig.run(1000)
    assert rig.cf.link_loss == 1.0


def test_lands_on_an_empty_battery(rig: Rig) -> None:
    rig.arm()
    rig.core.autopilot.detector.landed = False
    rig.peer.values["pm.vbat"] = 3.0
    rig.run(200)
    assert "Critical battery level" in rig.heard
    assert rig.core.autopilot.row.task is Task.LAND
