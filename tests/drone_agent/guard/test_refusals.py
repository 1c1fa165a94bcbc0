"""What the bridge lets pass to an autopilot: fresh setpoints of the owner, within bounds; no arming after a stop."""

import numpy as np
import pytest

from drone_agent.guard.config import GuardConfig
from drone_agent.guard.core import GuardCore
from drone_agent.guard.estimate import BodyEstimate
from drone_agent.guard.position import BodyHold
from drone_agent.guard.setpoints import TILT_MAX_RAD
from drone_agent.guard.stages import Stage
from formation.maths.arrays import Vec3
from formation.maths.frames import from_rotation_vector
from formation.messages import Datagram, LabFrame
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PROFILES, VehicleProfile
from tests.drone_agent.agent_harness import LEVEL, MS, S
from wire.autopilots.px4 import PX4
from wire.autopilots.table import FlightMode
from wire.link_messages import (
    BRIDGE_COMPONENT,
    Address,
    AttitudeSetpoint,
    CommandAck,
    Heartbeat,
    InertialSample,
    LinkMessage,
    LocalFrame,
    MavAutopilot,
    MavCommand,
    Packet,
    PositionIgnore,
    PositionSetpoint,
    Result,
    StatusText,
    TimeSync,
    command_long,
    ground_address,
)
from wire.mavlink.codec import Codec

DRONE, OLD, NEW = Address(1, 1), ground_address(0), ground_address(1)
AHEAD_NS = 900 * S
CUT = 21196.0


class Bridged:
    """A bridge whose autopilot is armed and off-board, and whose grounds answer TIMESYNC."""

    def __init__(self, **options: object) -> None:
        self.core = GuardCore(GuardConfig(body="b"), 0, **options)
        self.drone = Codec(DRONE)
        self.now_ns = 0
        self.rng = np.random.default_rng(1)
        self.passed: list[Packet] = []
        self.heard: list[Packet] = []
        self.turn()
        self.beat(FlightMode.OFFBOARD)

    def turn(self) -> None:
        out = self.core.tick(self.now_ns)
        self.passed += [p for d in out.to_autopilot for p in Codec(DRONE).receive(d.data)]
        for data in [d.data for d in out.to_ground]:
            self.heard += [p for p in Codec(NEW).receive(data) if isinstance(p.message, CommandAck)]
        for packet in [p for d in out.to_ground for p in Codec(OLD).receive(d.data)]:
            self.heard.append(packet)
            if isinstance(packet.message, TimeSync) and packet.message.tc1_ns == 0:
                for ground in (OLD, NEW):
                    answer = TimeSync(self.now_ns + AHEAD_NS, packet.message.ts1_ns, Address(1, BRIDGE_COMPONENT))
                    self.core.receive_ground(Datagram(1, Codec(ground).encode(answer)), self.now_ns)

    def beat(self, mode: FlightMode, *, armed: bool = True) -> None:
        beat = Heartbeat(MavAutopilot.PX4, 2, 128 if armed else 0, PX4.custom_mode(mode), 4)
        self.core.receive_autopilot(self.drone.frames(beat), self.now_ns)
        self.turn()

    def say(self, source: Address, message: LinkMessage) -> list[LinkMessage]:
        """What passes of it."""
        self.now_ns += 10 * MS
        self.core.receive_ground(Datagram(1, Codec(source).encode(message)), self.now_ns)
        before = len(self.passed)
        self.turn()
        return [p.message for p in self.passed[before:] if p.source == source]

    def setpoint(self, age_ms: int = 20, thrust: float = 0.5, q: np.ndarray = LEVEL) -> AttitudeSetpoint:
        stamp_ms = (self.now_ns + 10 * MS + AHEAD_NS) // MS - age_ms
        return AttitudeSetpoint(DRONE, stamp_ms, q, np.zeros(3), thrust, 7)

    def see(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.now_ns += 10 * MS
            pos = 1e-4 * self.rng.standard_normal((1, 3))
            frame = LabFrame(1, self.now_ns, ("b",), pos, LEVEL[None], np.array([True]))
            self.core.receive_frame(frame, self.now_ns)
            self.turn()

    @property
    def stage(self) -> Stage:
        return self.core._takeover.stream.stage

    def texts(self) -> list[str]:
        return [p.message.text for p in self.heard if isinstance(p.message, StatusText)]

    def acks(self) -> list[CommandAck]:
        return [p.message for p in self.heard if isinstance(p.message, CommandAck) and p.source == DRONE]


def test_old_and_repeated_setpoints_do_not_pass() -> None:
    site = Bridged()
    assert site.say(OLD, site.setpoint(99))
    assert not site.say(OLD, site.setpoint(101))
    newest = site.setpoint(20)
    assert site.say(OLD, newest)
    assert not site.say(OLD, newest)
    assert any("older than 100 ms" in text for text in site.texts())


def test_a_stream_of_old_setpoints_is_no_stream() -> None:
    site = Bridged()
    for _ in range(20):
        site.say(OLD, site.setpoint(20))
    assert site.stage is Stage.FOLLOW
    for _ in range(12):
        site.say(OLD, site.setpoint(300))
    assert site.stage is not Stage.FOLLOW


def test_a_setpoint_that_is_not_finite_does_not_pass() -> None:
    site = Bridged()
    assert not site.say(OLD, site.setpoint(thrust=float("nan")))
    assert any("not finite" in text for text in site.texts())


def test_only_the_owners_setpoints_pass_until_another_ground_takes_over() -> None:
    site = Bridged()
    site.see(0.1)
    assert site.say(OLD, site.setpoint())
    assert not site.say(NEW, site.setpoint())
    place = np.zeros(3)
    other = PositionSetpoint(
        DRONE, site.setpoint().t_boot_ms, LocalFrame.LOCAL, PositionIgnore.NONE, place, place, place, 0.0, 0.0
    )  # fmt: skip
    assert not site.say(NEW, other)
    assert not site.say(NEW, command_long(DRONE, MavCommand.REQUEST_OPERATOR_CONTROL, 0.0, 1.0))  # it answers itself
    assert [(ack.target, ack.result) for ack in site.acks()] == [(NEW, Result.ACCEPTED)]
    assert not site.say(OLD, site.setpoint())
    assert site.say(NEW, site.setpoint())
    assert site.stage is Stage.FOLLOW


def test_ownership_ends_when_the_autopilot_leaves_the_mode() -> None:
    site = Bridged()
    site.say(OLD, site.setpoint())
    site.beat(FlightMode.POSITION)
    assert site.say(NEW, site.setpoint())
    site.beat(FlightMode.OFFBOARD)
    assert site.say(NEW, site.setpoint())
    assert not site.say(OLD, site.setpoint())


def test_what_tilts_too_far_passes_bounded_in_its_senders_name() -> None:
    site = Bridged()
    (passed,) = site.say(OLD, site.setpoint(q=from_rotation_vector(np.array([1.4, 0.0, 0.0])), thrust=0.7))
    assert isinstance(passed, AttitudeSetpoint)
    np.testing.assert_allclose(
        passed.q_lab_from_flu, from_rotation_vector(np.array([TILT_MAX_RAD, 0.0, 0.0])), atol=1e-6
    )
    assert passed.thrust_norm == pytest.approx(0.7)
    assert site.core._setpoints.bounded.count == 1
    assert any(isinstance(p.message, StatusText) and "bounded: 1 x setpoint" in p.message.text for p in site.heard)


def test_setpoints_that_come_back_while_it_lands_do_not_pass() -> None:
    site = Bridged()
    site.say(OLD, site.setpoint())
    site.see(1.5)
    site.beat(FlightMode.OFFBOARD)
    assert site.stage is Stage.LAND
    assert not site.say(OLD, site.setpoint())


def test_a_stop_that_passed_latches_until_the_body_was_seen_at_rest() -> None:
    site = Bridged()
    arm = command_long(DRONE, MavCommand.COMPONENT_ARM_DISARM, 1.0)
    assert site.say(OLD, command_long(DRONE, MavCommand.COMPONENT_ARM_DISARM, 0.0, CUT))
    site.beat(FlightMode.HOLD, armed=False)
    site.see(1.0)
    assert not site.say(OLD, arm)
    assert site.acks()[-1].result is Result.TEMPORARILY_REJECTED
    site.see(1.2)
    assert not site.say(OLD, arm), "who goes on asking as before the stop does not know of it"
    site.see(2.1)
    assert site.say(OLD, arm)


def test_a_stop_is_asked_for_again_until_a_heartbeat_says_that_no_motor_turns() -> None:
    """The first one, or the autopilot's heartbeat, may be lost."""
    site = Bridged()
    site.say(OLD, command_long(DRONE, MavCommand.COMPONENT_ARM_DISARM, 0.0, CUT))

    def asked() -> int:
        before = len(site.passed)
        for _ in range(50):
            site.now_ns += 10 * MS
            site.turn()
        sent = [p.message for p in site.passed[before:] if p.source.component == BRIDGE_COMPONENT]
        return sum(m == command_long(DRONE, MavCommand.COMPONENT_ARM_DISARM, 0.0, CUT) for m in sent)

    assert asked() == 5
    site.beat(FlightMode.OFFBOARD)
    assert asked() == 5
    site.beat(FlightMode.HOLD, armed=False)
    assert asked() == 0


def test_without_a_pose_it_comes_down_by_attitude_and_thrust_until_the_autopilot_lands() -> None:
    site = Bridged()
    site.see(0.1)
    for _ in range(100):
        site.say(OLD, site.setpoint(thrust=0.5))
    before = len(site.passed)
    for _ in range(700):
        site.now_ns += 10 * MS
        site.turn()
        if site.now_ns % S == 0:
            site.beat(FlightMode.OFFBOARD)
    sent = [p.message for p in site.passed[before:] if p.source.component == BRIDGE_COMPONENT]
    thrusts = [m.thrust_norm for m in sent if isinstance(m, AttitudeSetpoint)]
    assert thrusts[0] == pytest.approx(0.475, abs=0.01)
    assert thrusts[-1] == 0.0
    assert all(m.q_lab_from_flu[0] > 0.999 for m in sent if isinstance(m, AttitudeSetpoint))
    commands = [m.command for m in sent if hasattr(m, "command")]
    assert commands.count(MavCommand.NAV_LAND) > 10
    assert MavCommand.COMPONENT_ARM_DISARM in commands


def flown(hold: BodyHold, estimate: BodyEstimate, now_ns: int, pos_lab_m: Vec3, thrust: float) -> None:
    """One pose, and one setpoint that passes."""
    estimate.receive_pose(now_ns, pos_lab_m, LEVEL, stands=False)
    estimate.receive_command(now_ns, thrust)
    hold.note(AttitudeSetpoint(DRONE, 1, LEVEL, np.zeros(3), thrust, 7), now_ns)


LINEAR = PROFILES["px4_quad"].model_copy(update={"drag_n_s_m": (0.0, 0.0, 0.0)})
OTHER = PROFILES["paper_40g"].model_copy(update={"drag_n_s_m": (0.0, 0.0, 0.0)})
"""Of another thrust and curve than what flies."""


@pytest.mark.parametrize(("vehicle", "tolerance"), [(LINEAR, 0.03), (OTHER, 0.1)])
@pytest.mark.parametrize("measured", [False, True])
def test_hover_thrust_is_known_of_a_body_that_climbs_ever_faster(
    measured: bool, vehicle: VehicleProfile, tolerance: float
) -> None:
    """Cut off in a take-off at 1.3 of its weight, it climbed on "coming down level" to 2.5 m; by either profile."""
    estimate, rng = BodyEstimate(vehicle, 1), np.random.default_rng(3)
    hold = BodyHold(estimate)
    for k in range(1, 101):
        t_s, now_ns = 0.01 * k, k * 10 * MS
        if measured:
            force = np.array([0.0, 0.0, 1.3 * GRAVITY_M_S2]) + 0.3 * rng.standard_normal(3)
            estimate.receive_imu(now_ns, InertialSample(0, force, np.zeros(3)))
        place = np.array([0.0, 0.0, 0.15 * GRAVITY_M_S2 * t_s**2]) + 1e-4 * rng.standard_normal(3)
        flown(hold, estimate, now_ns, place, 1.3 * 0.5)
    hold.begin(S)
    assert hold.descend_open_loop(0.01).thrust_norm == pytest.approx(0.95 * 0.5, rel=tolerance)


def test_a_refused_landing_does_not_interrupt_its_own() -> None:
    """Told to land every 0.3 s, in a mode that is known by a heartbeat a second: it was left without a setpoint."""
    site = Bridged()
    for _ in range(100):
        site.say(OLD, site.setpoint(thrust=0.5))
    gaps, last_ns = [], None
    for k in range(300):
        site.now_ns += 10 * MS
        before = len(site.passed)
        site.turn()
        if k % 30 == 0:
            site.say(OLD, command_long(DRONE, MavCommand.NAV_LAND))
        if k % 100 == 50:
            site.beat(FlightMode.OFFBOARD)
        own = [p for p in site.passed[before:] if isinstance(p.message, AttitudeSetpoint)]
        if own and last_ns is not None:
            gaps.append(site.now_ns - last_ns)
        last_ns = site.now_ns if own else last_ns
    assert site.stage is Stage.DESCEND
    assert max(gaps) <= 30 * MS
