"""The bridge between a ground and an autopilot: what passes, and what it does when the ground falls silent.

The autopilot here is our own simulated PX4 without the agent's fail-safe, fed through the bridge's bytes alone.
"""

from collections.abc import Callable

import numpy as np
import pytest

from drone_agent.bridge.core import BridgeCore
from drone_agent.config import AgentConfig
from drone_agent.simulation.inertial import InertialError
from formation.maths.arrays import Quat, Vec3
from formation.messages import Datagram, LabFrame
from tests.drone_agent.agent_harness import LEVEL, MS, Harness, S, Stream, hover_at, hover_over
from wire.autopilots.table import FlightMode
from wire.link_messages.address import BRIDGE_COMPONENT, GROUND, Address
from wire.link_messages.clocks import TimeSync
from wire.link_messages.commands import CommandAck, Result, command_long
from wire.link_messages.motion import LocalPosition, MocapPose, Origin, VisionPose
from wire.link_messages.packet import LinkMessage, Packet
from wire.link_messages.setpoints import AttitudeSetpoint
from wire.link_messages.status import NamedValue, StatusText
from wire.mavlink.codec import Codec

SENSORS = InertialError()
SIH = InertialError(noise_m_s2=1.52, rate_noise_rad_s=0.125)
"""The noise of an armed vehicle in PX4's own simulation."""
Pose = tuple[Vec3, Quat]


class Site:
    """Ground, bridge and autopilot, joined by functions; the autopilot is never shown the mocap itself."""

    def __init__(self, autopilot: str = "px4", inertial_error: InertialError = SENSORS, **config: object) -> None:
        options = {"GUID_OPTIONS": 8.0} if autopilot == "ardupilot" else {}
        self.drone = Harness(
            pose="mocap", guard=False, profile="px4_quad", autopilot=autopilot,
            parameters=options, inertial_error=inertial_error,
        )  # fmt: skip
        self.bridge = BridgeCore(AgentConfig(bridge="udp:h:1", body="b", **config), 0)
        self.ground = Codec(GROUND)
        self.heard: list[Packet] = []
        self.mocap = True
        self.slides_m_s, self._slid_m = 0.0, 0.0
        """How fast the shown pose slides along x."""
        self.spoil: Callable[[list[Pose], float], Pose] | None = None
        """The pose shown instead, of those until now and the time, s, since it was set."""
        self._poses: list[Pose] = []
        self._spoilt_ns: int | None = None
        self.now_ns = 0

    def say(self, *messages: LinkMessage) -> None:
        data = b"".join(self.ground.encode(message) for message in messages)
        self.bridge.receive_ground(Datagram(1, data), self.now_ns)
        self._turn()

    def run(self, seconds: float, stream: Callable[[Harness], AttitudeSetpoint] | None = None) -> None:
        end_ns = self.now_ns + round(seconds * S)
        while self.now_ns < end_ns:
            self.now_ns += 10 * MS
            while (due_ns := self.drone.core.next_deadline_ns()) <= self.now_ns:
                self._up(due_ns)
            self.drone.now_ns = self.now_ns
            if self.mocap:
                truth = self.drone.truth
                self._slid_m += 0.01 * self.slides_m_s
                pos = truth.pos_lab_m + np.array([self._slid_m, 0.0, 0.0])
                pos, q = self._shown(pos, truth.q_lab_from_flu)
                frame = LabFrame(0, self.now_ns, ("b",), pos[None], q[None], np.array([True]))
                self.bridge.receive_frame(frame, self.now_ns)
            if stream is not None:
                self.say(stream(self.drone))
            else:
                self._turn()

    def _shown(self, pos_lab_m: Vec3, q_lab_from_flu: Quat) -> Pose:
        self._poses.append((pos_lab_m, q_lab_from_flu))
        if self.spoil is None:
            return self._poses[-1]
        self._spoilt_ns = self._spoilt_ns or self.now_ns
        return self.spoil(self._poses, (self.now_ns - self._spoilt_ns) / S)

    def _turn(self) -> None:
        """Let what is under way arrive, until nothing is."""
        for _ in range(8):
            out = self.bridge.tick(self.now_ns)
            for datagram in out.to_autopilot:
                self.drone.core.receive(datagram, self.now_ns)
            for datagram in out.to_ground:
                self.heard += self.ground.receive(datagram.data)
            if not (self._up(self.now_ns) or out.to_autopilot):
                break

    def _up(self, t_ns: int) -> bool:
        """What the autopilot says at a time; whether it said anything."""
        said = self.drone.core.tick(t_ns).datagrams
        for datagram in said:
            self.bridge.receive_autopilot(datagram.data, t_ns)
        return bool(said)

    def command(self, number: int, *params: float) -> CommandAck:
        self.say(command_long(Address(1, 1), number, *params))
        return [p.message for p in self.heard if isinstance(p.message, CommandAck)][-1]

    def texts(self) -> list[str]:
        return [p.message.text for p in self.heard if isinstance(p.message, StatusText)]

    def fly(self, height_m: float = 0.6, stream: Stream | None = None) -> None:
        self.run(3.0)
        stream = stream or hover_at(height_m)
        self.run(0.2, hover_at(-1.0))
        assert self.command(176, 1.0, 6.0 if self.drone.config.autopilot == "px4" else 4.0).result == 0
        assert self.command(400, 1.0).result == 0
        self.run(5.0, stream)


def test_the_autopilot_gets_its_pose_from_the_bridge_alone() -> None:
    site = Site()
    site.run(2.0)
    assert any(isinstance(p.message, LocalPosition) and p.source == Address(1, 1) for p in site.heard)
    assert site.command(400, 1.0).result == 0


def test_frames_pass_byte_for_byte() -> None:
    bridge = BridgeCore(AgentConfig(bridge="serial:d:1"), 0, serial=True)
    bridge.tick(0)
    ground, drone = Codec(GROUND), Codec(Address(1, 1))
    unknown = b"\xfd\x01\x00\x00\x07\x01\x01\xff\xfe\x0e\x2a\x11\x22"
    down = ground.encode(command_long(Address(1, 1), 400, 1.0))
    bridge.receive_ground(Datagram(1, down + unknown), 1)
    up = drone.encode(LocalPosition(5, np.ones(3), np.zeros(3)))
    bridge.receive_autopilot(up[:7], 1)
    bridge.receive_autopilot(b"noise" + up[7:], 1)
    bridge.receive_autopilot(up[:9], 1)
    bridge.receive_autopilot(up[9:] + unknown, 1)
    out = bridge.tick(1)
    assert b"".join(d.data for d in out.to_autopilot) == down + unknown
    assert b"".join(d.data for d in out.to_ground) == up + unknown


def test_the_grounds_poses_end_here_while_the_bridge_has_its_own() -> None:
    bridge = BridgeCore(AgentConfig(bridge="udp:h:1", body="b"), 0)
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
    site = Site(autopilot, inertial_error=SIH)
    site.fly(stream=hover_over(0.0, 0.0, 0.6))
    place = site.drone.truth.pos_lab_m
    assert site.drone.truth.vel_lab_m_s == pytest.approx([0.0, 0.0, 0.0], abs=0.1)
    drift_m = []
    for _ in range(70):
        site.run(0.1)
        drift_m.append(float(np.linalg.norm((site.drone.truth.pos_lab_m - place)[:2])))
    assert "Setpoints are stale: level and hold" in site.texts()
    assert not site.drone.autopilot.armed
    # By level targets, a hold that PX4 refuses and its own landing: 0.088 here, where its idea of level alone is wrong;
    # 0.25 to 0.34 on v1.16.1 SIH, whose position wanders too.
    assert max(drift_m) < 0.06


@pytest.mark.parametrize("autopilot", ["px4", "ardupilot"])
def test_brakes_what_the_ground_left_in_motion(autopilot: str) -> None:
    site = Site(autopilot)
    site.fly()
    lean = np.array([np.cos(0.1), 0.0, np.sin(0.1), 0.0])
    hover = site.drone.config.true_vehicle().hover_thrust_norm
    site.run(0.3, lambda b: AttitudeSetpoint(b.target, 0, lean, np.zeros(3), hover, 7))
    place, speed_m_s = site.drone.truth.pos_lab_m[0], site.drone.truth.vel_lab_m_s[0]
    site.run(1.1)
    truth = site.drone.truth
    assert truth.pos_lab_m[0] - place < 0.6  # level targets alone carried it on at 0.7 m/s
    assert abs(truth.vel_lab_m_s[0]) < 0.25 < speed_m_s + 0.25
    assert truth.pos_lab_m[2] == pytest.approx(0.6, abs=0.1)
    site.run(6.0)
    assert not site.drone.autopilot.armed


def test_a_real_px4_holds_in_no_mode_of_its_own_on_a_mocap_alone() -> None:
    site = Site()
    site.fly()
    assert site.command(176, 1.0, 4.0, 3.0).result is Result.TEMPORARILY_REJECTED
    assert site.drone.autopilot.mode is FlightMode.OFFBOARD
    assert site.command(21).result is Result.ACCEPTED


def test_poses_pass_at_fifty_a_second_though_frames_jitter() -> None:
    bridge = BridgeCore(AgentConfig(bridge="udp:h:1", body="b"), 0)
    rng, sent_ns = np.random.default_rng(1), []
    autopilot = Codec(Address(1, 1))
    for k in range(1000):
        now_ns = k * 10 * MS + int(rng.normal(0.0, 0.5 * MS)) + 8 * MS
        pos = 1e-4 * rng.standard_normal((1, 3))
        bridge.receive_frame(LabFrame(k, now_ns, ("b",), pos, LEVEL[None], np.array([True])), now_ns)
        for datagram in bridge.tick(now_ns).to_autopilot:
            sent_ns += [now_ns for p in autopilot.receive(datagram.data) if isinstance(p.message, VisionPose)]
    assert len(sent_ns) == pytest.approx(500, abs=3)  # 20 ms after the last one, of frames that jitter: 40 a second


def test_without_a_pose_it_lands_at_once() -> None:
    site = Site()
    site.fly()
    site.mocap = False
    site.run(0.3, hover_at(0.6))
    site.run(0.5)
    assert site.drone.autopilot.mode in (FlightMode.LAND, FlightMode.DESCEND)


def test_a_stream_that_comes_back_goes_on() -> None:
    site = Site()
    site.fly()
    site.run(0.25)
    site.run(1.0, hover_at(0.6))
    assert "Setpoints are back" in site.texts()
    assert site.drone.autopilot.mode is FlightMode.OFFBOARD
    assert site.drone.truth.pos_lab_m[2] == pytest.approx(0.6, abs=0.08)


def test_a_landing_of_the_grounds_is_left_alone() -> None:
    site = Site()
    site.fly()
    assert site.command(21).result == 0
    site.run(6.0)
    assert not any("stale" in text for text in site.texts())
    assert not site.drone.autopilot.armed


def test_gives_an_ardupilot_its_origin_once() -> None:
    site = Site("ardupilot")
    site.run(4.0)
    origin = site.drone.autopilot.origin
    assert origin is not None
    assert origin[0] == pytest.approx(47.397742, abs=1e-6)
    assert sum(isinstance(p.message, Origin) for p in site.heard) == 1


def test_an_ardupilot_that_restarted_is_given_its_origin_again() -> None:
    site = Site("ardupilot")
    site.run(4.0)
    site.drone = Harness(
        pose="mocap", guard=False, profile="px4_quad", autopilot="ardupilot",
        parameters={"GUID_OPTIONS": 8.0},
    )  # fmt: skip
    site.now_ns += 3 * S  # it boots
    while site.drone.core.next_deadline_ns() < site.now_ns:
        site.drone.core.tick(site.drone.core.next_deadline_ns())
    site.run(4.0)
    assert site.drone.autopilot.origin is not None


def test_tells_of_an_autopilot_with_another_number() -> None:
    site = Site()
    other = Codec(Address(7, 1)).encode(LocalPosition(5, np.ones(3), np.zeros(3)))
    site.bridge.receive_autopilot(other, 1)
    out = site.bridge.tick(1)
    assert [e.text for e in out.events] == ["The autopilot says it is system 7, not 1"]
    heard = site.ground.receive(out.to_ground[0].data)
    assert not any(isinstance(p.message, LocalPosition) for p in heard)


def test_reports_the_age_of_setpoints_on_the_grounds_clock() -> None:
    site = Site()
    site.run(0.05)
    request = next(
        p.message for p in site.heard if isinstance(p.message, TimeSync) and p.source.component == BRIDGE_COMPONENT
    )
    ahead_ns = 77 * S
    site.say(TimeSync(request.ts1_ns + ahead_ns, request.ts1_ns, Address(1, BRIDGE_COMPONENT)))
    site.run(1.0)
    stamp_ms = (site.now_ns + ahead_ns - 25 * MS) // MS
    site.say(AttitudeSetpoint(Address(1, 1), stamp_ms, LEVEL, np.zeros(3), 0.0, 7))
    ages = [p.message.value for p in site.heard if isinstance(p.message, NamedValue)]
    assert ages[-1] == pytest.approx(25.0, abs=50.0)
