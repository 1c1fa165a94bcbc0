"""The bridge to a real autopilot, without its sockets: passes MAVLink on both ways and enforces the agent's rules.

The last line of defence beside a real drone, whatever becomes of the ground: where the stream of setpoints has gone
stale, this process holds the body on its own mocap feed, then lets it down; the autopilot is told the mocap pose of
its body by this process, not by the ground. Frames pass byte for byte, sender and all.
"""

import numpy as np

from drone_agent.bridge.feed import BodyFeed
from drone_agent.bridge.hold import BridgeHold
from drone_agent.bridge.inertial_stream import LACKS, InertialStream
from drone_agent.bridge.outgoing import BridgeOutgoing, datagrams
from drone_agent.bridge.reckoning import Reckoning
from drone_agent.bridge.setpoints import SETPOINTS, BridgeSetpoints, stamp_ms
from drone_agent.bridge.takeover import STEP_NS, Takeover, Turn
from drone_agent.config import AgentConfig
from drone_agent.failsafe import BACK, REPORTS, SLIDING_POSE, STOPPED, TAKEN_OVER
from drone_agent.monitors import switched_off
from drone_agent.stages import Stage
from formation.messages import Datagram, Event, LabFrame, Severity
from wire.autopilots.ardupilot import ARDUPILOT
from wire.autopilots.px4 import PX4
from wire.autopilots.table import STREAM_MODES, AutopilotTable
from wire.link_messages.address import BRIDGE_COMPONENT, DRONE_COMPONENT, Address
from wire.link_messages.clocks import TimeSync
from wire.link_messages.commands import (
    DISARM_IN_FLIGHT,
    CommandAck,
    CommandInt,
    CommandLong,
    MavCommand,
    Result,
    SetMode,
    command_long,
)
from wire.link_messages.message_id import MessageId
from wire.link_messages.motion import InertialSample, Origin, SetOrigin
from wire.link_messages.packet import LinkMessage
from wire.link_messages.setpoints import AttitudeSetpoint, Ignore
from wire.link_messages.status import Heartbeat, MavAutopilot, MavState, MavType, NamedValue, StatusText
from wire.mavlink.codec import Codec, MavlinkError, read_frame
from wire.mavlink.framing import Frame, FrameCutter
from wire.timesync import slip_text

_POSES = frozenset({MessageId.VISION_POSITION_ESTIMATE, MessageId.ATT_POS_MOCAP, MessageId.ODOMETRY})
# What is read here; the rest passes.
_READS = frozenset(
    {
        MessageId.HEARTBEAT,
        MessageId.SET_MODE,
        MessageId.GPS_GLOBAL_ORIGIN,
        MessageId.COMMAND_LONG,
        MessageId.COMMAND_INT,
        MessageId.COMMAND_ACK,
        MessageId.TIMESYNC,
        MessageId.HIGHRES_IMU,
    }
)
_BEAT_NS = 1_000_000_000
_HEARTBEAT = Heartbeat(MavAutopilot.INVALID, MavType.ONBOARD_CONTROLLER, 0, 0, MavState.ACTIVE)
_SILENT_NS = 1_500_000_000  # of heartbeats a second: it may have restarted, and forgotten its origin
_SETS_MODE = frozenset(
    {
        MavCommand.NAV_RETURN_TO_LAUNCH,
        MavCommand.NAV_LAND,
        MavCommand.NAV_TAKEOFF,
        MavCommand.DO_SET_MODE,
        MavCommand.DO_FLIGHTTERMINATION,
        MavCommand.DO_REPOSITION,
        MavCommand.COMPONENT_ARM_DISARM,
    }
)
_TABLES = {table.autopilot: table for table in (PX4, ARDUPILOT)}


class BridgeCore:
    """One real drone. Call a `receive_*` with what arrives and `tick` no later than `next_deadline_ns`."""

    def __init__(
        self, config: AgentConfig, t0_ns: int, *, serial: bool = False, without: frozenset[str] = frozenset()
    ) -> None:
        """serial: the autopilot's bytes come as a stream, not as datagrams.

        without: monitors to do without (drone_agent.monitors), else ValueError.
        """
        self._without = switched_off(without)
        self._config = config
        self._t0_ns = self._now_ns = t0_ns
        self._target = Address(config.sysid, DRONE_COMPONENT)
        self._codec = Codec(Address(config.sysid, BRIDGE_COMPONENT))
        self._from_ground, self._from_autopilot = FrameCutter(), FrameCutter(stream=serial)
        self._autopilots_name = Codec(self._target)
        stale_s = 0.0 if "stream-stale" in without else config.stale_setpoint_s
        self._takeover = Takeover(stale_s, None if "own-land" in without else config.land_after_s)
        self._setpoints = BridgeSetpoints(config.sysid, t0_ns, self._takeover.stream, self._without)
        self._table: AutopilotTable | None = None
        self._lacks_origin = False
        self._heard_ns = t0_ns
        self._beat_ns = t0_ns
        self._hold = BridgeHold()
        self._hold_ns = t0_ns
        reckoning = Reckoning()
        self._inertial = InertialStream(self._target, config.inertial_rate_hz, reckoning, t0_ns)
        finds = "pose-slides" not in without
        self._feed = BodyFeed(config.body_name, self._hold, reckoning, t0_ns, finds_slides=finds)
        self._age_sent_ns = t0_ns
        self._strangers: set[int] = set()
        self._slip_reported = False
        self._to_ground: list[bytes] = []
        self._to_autopilot: list[bytes] = []
        self._events: list[Event] = []

    def receive_ground(self, datagram: Datagram, now_ns: int) -> None:
        """Pass what the ground says on to the autopilot, reading what matters."""
        self._now_ns = now_ns
        for frame in self._from_ground.cut(datagram.data):
            if not self._keep_from_ground(frame, now_ns):
                self._to_autopilot.append(frame.data)

    def receive_autopilot(self, data: bytes, now_ns: int) -> None:
        """Pass what the autopilot says on to the ground, reading what matters."""
        self._now_ns = now_ns
        for frame in self._from_autopilot.cut(data):
            if not self._keep_from_autopilot(frame, now_ns):
                self._to_ground.append(frame.data)

    def receive_frame(self, frame: LabFrame, now_ns: int) -> None:
        """Tell the autopilot the pose of its body, and hold the body where that pose is none of its own."""
        self._now_ns = now_ns
        pose = self._feed.see(frame, now_ns, armed=self._takeover.armed)
        if self._feed.fresh(now_ns):
            self._takeover.rest(now_ns, still=self._hold.still)
        self._setpoints.pose_slides = self._feed.slides
        if self._feed.slides and self._takeover.slid(now_ns):
            self._say(*SLIDING_POSE)
            self._hold.begin(now_ns)
        if pose is not None:
            self._send_autopilot(pose)

    def tick(self, now_ns: int) -> BridgeOutgoing:
        """Everything to send now."""
        self._now_ns = now_ns
        if now_ns >= self._beat_ns:
            self._beat_ns = now_ns + _BEAT_NS
            self._send_autopilot(_HEARTBEAT)
            self._send_ground(TimeSync(0, now_ns))
            if self._lacks_origin and self._feed.begun:
                self._send_autopilot(SetOrigin(self._config.sysid, *self._config.origin))
            asks = self._inertial.due(now_ns) if self._table is not None else None
            if asks is not None:
                self._send_autopilot(asks)
            if self._inertial.tells(now_ns):
                self._say(Severity.NOTICE, LACKS)
        asks_clock = self._inertial.sync.due(now_ns) if self._table is not None else None
        if asks_clock is not None:
            self._send_autopilot(asks_clock)
        self._act(self._takeover.due(now_ns, fed=self._feed.fresh(now_ns), stands=self._hold.stands))
        for refused in self._setpoints.told(now_ns):
            self._say(refused.severity, f"{refused.text} (from {refused.source})")
        outgoing = BridgeOutgoing(
            datagrams(self._config.sysid, self._to_ground),
            datagrams(self._config.sysid, self._to_autopilot),
            tuple(self._events),
        )
        self._to_ground, self._to_autopilot, self._events = [], [], []
        return outgoing

    @property
    def has_autopilot(self) -> bool:
        """Whether a heartbeat of the drone's autopilot has come."""
        return self._table is not None

    @property
    def has_pose(self) -> bool:
        """Whether the mocap has shown the body."""
        return self._feed.begun

    def next_deadline_ns(self) -> int:
        """When `tick` is due if nothing arrives."""
        if self._to_ground or self._to_autopilot or self._events:
            return self._now_ns
        takeover_ns = self._takeover.deadline_ns()
        return self._beat_ns if takeover_ns is None else min(self._beat_ns, takeover_ns)

    def _keep_from_ground(self, frame: Frame, now_ns: int) -> bool:
        """Note what matters; True for a frame that ends here."""
        if frame.number in _POSES:
            return self._feed.slides or self._feed.fresh(now_ns)
        if frame.number in SETPOINTS:
            return self._keep_setpoint(frame, now_ns)
        if frame.number not in _READS:
            return False
        try:
            message = read_frame(frame).message
        except MavlinkError:
            return False
        if isinstance(message, CommandLong | CommandInt):
            return self._keep_command(frame.source, message, now_ns)
        if isinstance(message, SetMode):
            self._takeover.mode_unknown()
        elif isinstance(message, TimeSync) and message.target.component == BRIDGE_COMPONENT and message.tc1_ns:
            clock = self._setpoints.gate.clock(frame.source)
            clock.exchange(message.ts1_ns - self._t0_ns, message.tc1_ns, now_ns - self._t0_ns)
            return True
        return False

    def _keep_setpoint(self, frame: Frame, now_ns: int) -> bool:
        """Pass on a setpoint that is obeyed, within bounds."""
        setpoints, source = self._setpoints, frame.source
        self._report_age(source, stamp_ms(frame), now_ns)
        taken = setpoints.take(frame, now_ns)
        if taken.passed is None:
            return True
        back = taken.target is not None and self._takeover.note(source, now_ns)
        if taken.target is not None and self._takeover.stream.broken:
            return True
        self._to_autopilot.append(taken.passed)
        if setpoints.gate.asks(source, now_ns):
            self._send_ground(TimeSync(0, now_ns))
        if self._takeover.stream.stage is Stage.FOLLOW and setpoints.gate.untold(source):
            self._say(Severity.INFO, f"Age of setpoints of {source} unknown: no TIMESYNC")
        if taken.target is not None:
            self._hold.note(taken.target, now_ns)
        if back:
            self._say(*BACK)
        return True

    def _keep_command(self, source: Address, message: CommandLong | CommandInt, now_ns: int) -> bool:
        """Note what a command may change; those that are this process's own to answer end here."""
        if message.command == MavCommand.REQUEST_OPERATOR_CONTROL:
            stage = self._takeover.hand_over(source, message.params[1] == 1.0, now_ns)
            if stage is Stage.HOLD:
                self._say(*TAKEN_OVER)
                self._hold.begin(now_ns)
            self._answer(source, message.command, Result.ACCEPTED)
            return True
        if isinstance(message, CommandLong) and self._inertial.requested(message):
            self._answer(source, message.command, Result.ACCEPTED)
            return True
        action, force = message.params[0], message.params[1]
        if message.command == MavCommand.COMPONENT_ARM_DISARM:
            if action == 1.0 and self._takeover.stream.stage is Stage.STOPPED:
                self._takeover.stop(now_ns)  # who goes on asking as before the stop does not know of it
                self._say(Severity.CRITICAL, f"Arm refused: {STOPPED}")
                self._answer(source, message.command, Result.TEMPORARILY_REJECTED)
                return True
            stops = action == 0.0 and force == DISARM_IN_FLIGHT
        else:
            stops = message.command == MavCommand.DO_FLIGHTTERMINATION and action > 0.5
        if stops and "stop-latch" not in self._without:
            self._takeover.stop(now_ns)
        if message.command in _SETS_MODE:
            self._takeover.mode_unknown()
        return False

    def _answer(self, source: Address, command: int, result: Result) -> None:
        """In the autopilot's name, to which the command was sent."""
        self._to_ground.append(self._autopilots_name.encode(CommandAck(source, command, result)))

    def _keep_from_autopilot(self, frame: Frame, now_ns: int) -> bool:
        if frame.source.system != self._config.sysid:
            self._report_stranger(frame.source.system)
            return True
        if frame.number not in _READS:
            return False
        try:
            packet = read_frame(frame)
        except MavlinkError:
            return False
        message = packet.message
        if isinstance(message, Heartbeat) and packet.source.component == DRONE_COMPONENT:
            self._see(message)
        elif isinstance(message, Origin):
            self._lacks_origin = False
        elif isinstance(message, CommandAck) and message.target.component == BRIDGE_COMPONENT:
            self._takeover.acknowledged(message)
            self._inertial.answered(message)
            return True
        elif isinstance(message, InertialSample):
            self._inertial.hear(message, now_ns)
            self._hold.feel(float(message.specific_force_flu_m_s2[2]), now_ns)
            return not self._inertial.passes
        elif isinstance(message, TimeSync) and message.tc1_ns:
            ours = self._inertial.sync.answers(message)
            self._inertial.sync.receive(message, now_ns)
            self._report_slip()
            return ours
        elif isinstance(message, TimeSync):
            # Its poses come from here, so the clock it holds them against must be ours.
            self._send_autopilot(TimeSync(now_ns, message.ts1_ns, packet.source))
            return True
        return False

    def _see(self, beat: Heartbeat) -> None:
        table = _TABLES.get(beat.autopilot)
        if table is None:
            return
        silent_ns, self._heard_ns = self._now_ns - self._heard_ns, self._now_ns
        if self._table is not table or silent_ns > _SILENT_NS:
            self._lacks_origin = table.needs_origin
            self._inertial.restarted(self._now_ns)
        if self._table is not table:
            self._table = table
            self._say(Severity.INFO, f"Bridge to {table.autopilot.name.lower()}")
        offboard = table.mode_of(beat.custom_mode) in STREAM_MODES
        self._takeover.saw(self._now_ns, armed=beat.armed, offboard=offboard)

    def _act(self, turn: Turn) -> None:
        """Carry out what the fail-safe asks for."""
        for stage in turn.begun:
            if stage is Stage.HOLD:
                self._hold.begin(self._now_ns)
            if stage is not Stage.HOLD or self._takeover.stream.tells:
                self._say(*REPORTS[stage])
        if turn.flown is not None:
            self._fly(down=turn.flown is not Stage.HOLD, blind=turn.flown is Stage.DESCEND)
        if turn.lands:
            self._send_autopilot(command_long(self._target, MavCommand.NAV_LAND, 0.0, 0.0, 0.0, float("nan")))
        if turn.lands and self._hold.faded:
            self._send_autopilot(command_long(self._target, MavCommand.COMPONENT_ARM_DISARM))

    def _fly(self, *, down: bool, blind: bool) -> None:
        """One attitude target of our own."""
        dt_s = min(self._now_ns - self._hold_ns, 5 * STEP_NS) * 1e-9
        self._hold_ns = self._now_ns
        wanted = self._hold.sink_blind(dt_s) if blind else self._hold.step(self._now_ns, dt_s, down=down)
        t_boot_ms = self._now_ns // 1_000_000 % 2**32  # on the clock of our answers to TIMESYNC
        rate, thrust = np.zeros(3), wanted.thrust_norm
        self._send_autopilot(
            AttitudeSetpoint(self._target, t_boot_ms, wanted.q_lab_from_flu, rate, thrust, Ignore.BODY_RATES)
        )

    def _report_age(self, source: Address, stamp: int, now_ns: int) -> None:
        rate_hz = self._config.age_rate_hz
        age_ms = self._setpoints.gate.age_ms(source, stamp, now_ns - self._t0_ns)
        if age_ms is not None and rate_hz > 0.0 and now_ns - self._age_sent_ns >= 1e9 / rate_hz:
            self._age_sent_ns = now_ns
            self._send_ground(NamedValue((now_ns - self._t0_ns) // 1_000_000, "age_ms", age_ms))

    def _report_slip(self) -> None:
        """Name an autopilot's clock that runs at another rate, once."""
        slip = self._inertial.sync.slip
        if slip is not None and not self._slip_reported:
            self._slip_reported = True
            self._say(Severity.WARNING, f"Autopilot's {slip_text(slip)}")

    def _report_stranger(self, system: int) -> None:
        if system not in self._strangers:
            self._strangers.add(system)
            self._say(Severity.ERROR, f"The autopilot says it is system {system}, not {self._config.sysid}")

    def _say(self, severity: Severity, text: str) -> None:
        self._send_ground(StatusText(severity, text))
        self._events.append(Event(severity, f"uav{self._config.sysid}", text))

    def _send_ground(self, message: LinkMessage) -> None:
        self._to_ground.append(self._codec.encode(message))

    def _send_autopilot(self, message: LinkMessage) -> None:
        self._to_autopilot.append(self._codec.encode(message))
