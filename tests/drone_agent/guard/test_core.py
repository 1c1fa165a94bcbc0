"""The bridge between a ground and an autopilot: what passes, and what it does when the ground falls silent.

The autopilot here is our own simulated one without a fail-safe of ours, fed through the bridge's bytes alone.
"""

import numpy as np
import pytest

from drone_agent.core import AgentCore
from drone_agent.guard.config import GuardConfig
from drone_agent.guard.core import GuardCore
from drone_agent.simulation.inertial import InertialError
from formation.messages import Datagram, LabFrame
from gcs.drones.telemetry import SequenceMonitor
from tests.drone_agent.agent_harness import LEVEL, MS, Harness, S, hover_over
from wire.autopilots.table import FlightMode
from wire.link_messages import (
    BRIDGE_COMPONENT,
    GROUND,
    Address,
    LocalPosition,
    MavCommand,
    MocapPose,
    Result,
    VisionPose,
    command_long,
)
from wire.mavlink.codec import Codec
from wire.mavlink.framing import FrameCutter

SIH = InertialError(noise_m_s2=1.52, rate_noise_rad_s=0.125)
"""The noise of an armed vehicle in PX4's own simulation."""


def test_frames_pass_byte_for_byte() -> None:
    bridge, line = GuardCore(GuardConfig(), 0), FrameCutter(stream=True)
    bridge.tick(0)
    ground, drone = Codec(GROUND), Codec(Address(1, 1))
    unknown = b"\xfd\x01\x00\x00\x07\x01\x01\xff\xfe\x0e\x2a\x11\x22"
    down = ground.encode(command_long(Address(1, 1), 400, 1.0))
    bridge.receive_ground(Datagram(1, down + unknown), 1)
    up = drone.encode(LocalPosition(5, np.ones(3), np.zeros(3)))
    bridge.receive_autopilot(line.cut(up[:7]), 1)
    bridge.receive_autopilot(line.cut(b"noise" + up[7:]), 1)
    bridge.receive_autopilot(line.cut(up[:9]), 1)
    bridge.receive_autopilot(line.cut(up[9:] + unknown), 1)
    out = bridge.tick(1)
    assert b"".join(d.data for d in out.to_autopilot) == down + unknown
    assert b"".join(d.data for d in out.to_ground) == up + unknown


def test_answers_in_the_autopilots_name_are_no_gap_in_its_numbers() -> None:
    """The doctor once measured 18 to 55 % of packets lost on links that lost none."""
    bridge, ground, autopilot, link = (
        GuardCore(GuardConfig(), 0),
        Codec(GROUND),
        Codec(Address(1, 1)),
        SequenceMonitor(),
    )
    takes_control = command_long(Address(1, 1), int(MavCommand.REQUEST_OPERATOR_CONTROL), 0.0, 1.0)
    for k in range(300):
        bridge.receive_autopilot(FrameCutter().cut(autopilot.encode(LocalPosition(k, np.ones(3), np.zeros(3)))), k * MS)
        if k in (150, 200, 250):
            bridge.receive_ground(Datagram(1, ground.encode(takes_control)), k * MS)
        for packet in (p for d in bridge.tick(k * MS).to_ground for p in Codec(GROUND).receive(d.data)):
            if packet.source == Address(1, 1):
                link.note(packet.seq, k * MS)
    assert (link.received, link.lost) == (303, 0)


def test_the_grounds_poses_end_here_while_the_bridge_has_its_own() -> None:
    bridge = GuardCore(GuardConfig(body="b"), 0)
    bridge.tick(0)
    pose = Codec(GROUND).encode(MocapPose(1, np.zeros(3), LEVEL))
    bridge.receive_ground(Datagram(1, pose), 1)
    assert bridge.tick(1).to_autopilot[0].data == pose
    frame = LabFrame(1, 100 * MS, ("b",), np.zeros((1, 3)), LEVEL[None], np.array([True]))
    bridge.receive_frame(frame, 100 * MS)
    bridge.receive_ground(Datagram(1, pose), 100 * MS)
    sent = Codec(Address(1, 1)).receive(bridge.tick(100 * MS).to_autopilot[0].data)
    assert [(type(p.message), p.source) for p in sent] == [(VisionPose, Address(1, BRIDGE_COMPONENT))]
    bridge.receive_ground(Datagram(1, pose), 900 * MS)
    assert bridge.tick(900 * MS).to_autopilot[0].data == pose


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_holds_its_place_and_lets_it_down_when_the_ground_falls_silent(autopilot: str) -> None:
    options = {"GUID_OPTIONS": 8.0} if autopilot == "ardupilot" else {}
    drone = Harness(pose="mocap", profile="px4_quad", autopilot=autopilot, parameters=options, inertial_error=SIH)
    drone.fly_offboard(0.6, hover_over(0.0, 0.0, 0.6))
    drone.run(1.0, hover_over(0.0, 0.0, 0.6))
    place = drone.truth.pos_lab_m
    drift_m = []
    for _ in range(70):
        drone.run(0.1)
        drift_m.append(float(np.linalg.norm((drone.truth.pos_lab_m - place)[:2])))
    assert "Setpoints are stale: level and hold" in drone.texts()
    assert not drone.autopilot.armed
    # By level targets, a hold that PX4 refuses and its own landing: 0.088 here, where its idea of level alone is wrong;
    # 0.25 to 0.34 on v1.16.1 SIH, whose position wanders too.
    assert max(drift_m) < 0.06


def test_a_real_px4_holds_in_no_mode_of_its_own_on_a_mocap_alone() -> None:
    drone = Harness(pose="mocap", profile="px4_quad")
    drone.fly_offboard(0.6)
    assert drone.command(176, 1.0, 4.0, 3.0) is Result.TEMPORARILY_REJECTED
    assert drone.autopilot.mode is FlightMode.OFFBOARD
    assert drone.command(21) is Result.ACCEPTED


def test_poses_pass_at_fifty_a_second_though_frames_jitter() -> None:
    bridge = GuardCore(GuardConfig(body="b"), 0)
    rng, sent_ns = np.random.default_rng(1), []
    autopilot = Codec(Address(1, 1))
    for k in range(1000):
        now_ns = k * 10 * MS + int(rng.normal(0.0, 0.5 * MS)) + 8 * MS
        pos = 1e-4 * rng.standard_normal((1, 3))
        bridge.receive_frame(LabFrame(k, now_ns, ("b",), pos, LEVEL[None], np.array([True])), now_ns)
        for datagram in bridge.tick(now_ns).to_autopilot:
            sent_ns += [now_ns for p in autopilot.receive(datagram.data) if isinstance(p.message, VisionPose)]
    assert len(sent_ns) == pytest.approx(500, abs=3)  # 20 ms after the last one, of frames that jitter: 40 a second


def test_an_ardupilot_is_given_its_origin_and_again_after_a_restart() -> None:
    drone = Harness(pose="mocap", profile="px4_quad", autopilot="ardupilot")
    for _ in range(2):
        drone.run(4.0)
        origin = drone.autopilot.origin
        assert origin is not None
        assert origin[0] == pytest.approx(47.397742, abs=1e-6)
        drone.now_ns += 3 * S  # it boots
        drone.core.autopilot = AgentCore(drone.config, drone.now_ns)
        assert drone.autopilot.origin is None


def test_tells_of_an_autopilot_with_another_number() -> None:
    bridge = GuardCore(GuardConfig(body="b"), 0)
    bridge.receive_autopilot(Codec(Address(7, 1)).frames(LocalPosition(5, np.ones(3), np.zeros(3))), 1)
    out = bridge.tick(1)
    assert [e.text for e in out.events] == ["The autopilot says it is system 7, not 1"]
    heard = [p.message for d in out.to_ground for p in Codec(GROUND).receive(d.data)]
    assert not any(isinstance(message, LocalPosition) for message in heard)
