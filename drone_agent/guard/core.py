"""The bridge to a real autopilot, without its sockets: passes MAVLink on both ways and enforces the agent's rules.

The last line of defence beside a real drone, whatever becomes of the ground: where the stream of setpoints has gone
stale, this process holds the body on its own mocap feed, then lands it. This process, not the ground, sends the
autopilot the mocap pose of its body. Frames pass byte for byte, sender and all; only an autopilot's are numbered anew
where some have ended here.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from drone_agent.guard import estimate, position
from drone_agent.guard.allow_list import POSES, SETS_MODE, list_reject_reason
from drone_agent.guard.config import GuardConfig
from drone_agent.guard.estimate import LACKS, BodyEstimate, BodyFeed, InertialStream
from drone_agent.guard.failsafe import (
    ATTITUDE_LOSS,
    BACK,
    LANDS_ITSELF,
    NEW_OWNER,
    REPORTS,
    STEP_NS,
    STOPPED,
    THRUST_LOSS,
    Takeover,
    Turn,
    pose_fault,
)
from drone_agent.guard.integrity import SIGNATURES
from drone_agent.guard.navigator import Fault
from drone_agent.guard.position import BodyHold
from drone_agent.guard.setpoints import SETPOINTS, BodySetpoints, Sender, stamp_ms
from drone_agent.guard.stages import MONITOR_OF, Stage, Trigger
from formation.maths.arrays import Quat
from formation.messages import Datagram, Event, Innovation, LabFrame, Severity
from formation.vehicle.profile import profile
from wire.autopilots.ardupilot import ARDUPILOT
from wire.autopilots.crazyflie import CRAZYFLIE
from wire.autopilots.px4 import PX4
from wire.autopilots.table import STREAM_MODES, AutopilotTable
from wire.clock_offset import rate_offset_text
from wire.link_messages import (
    BRIDGE_COMPONENT,
    DISARM_IN_FLIGHT,
    DRONE_COMPONENT,
    Address,
    AttitudeQuaternion,
    AttitudeSetpoint,
    CommandAck,
    CommandInt,
    CommandLong,
    Heartbeat,
    Ignore,
    InertialSample,
    LinkMessage,
    MavAutopilot,
    MavCommand,
    MavState,
    MavType,
    MessageId,
    NamedValue,
    Origin,
    Result,
    SetMode,
    SetOrigin,
    StatusText,
    TimeSync,
    UnknownMessage,
    command_long,
)
from wire.mavlink.codec import Codec, read_message
from wire.mavlink.framing import Frame, FrameCutter, MavlinkError, packed, renumbered

_BEAT_NS = 1_000_000_000
_HEARTBEAT = Heartbeat(MavAutopilot.INVALID, MavType.ONBOARD_CONTROLLER, 0, 0, MavState.ACTIVE)
_SILENT_NS = 1_500_000_000  # of heartbeats a second: it may have restarted, and forgotten its origin
_TABLES = (PX4, ARDUPILOT, CRAZYFLIE)


class GuardOutgoing(NamedTuple):
    """The output of one tick: for the ground, frames for the autopilot, events, innovations, detected faults."""

    to_ground: tuple[Datagram, ...]
    to_autopilot: list[Frame]
    events: list[Event]
    innovations: tuple[Innovation, ...]
    faults: list[Fault]


def datagrams(sysid: int, packets: list[bytes]) -> tuple[Datagram, ...]:
    """The packets for, or of, that drone in as few datagrams as hold them."""
    return tuple(map(Datagram, repeat(sysid), packed(b"".join(packets))))


class GuardCore:
    """One real drone. Call a `receive_*` with what arrives and `tick` no later than `due_ns`."""

    def __init__(self, config: GuardConfig, t0_ns: int, *, without: frozenset[str] = frozenset()) -> None:
        """without: of drone_agent.guard.stages.MONITORS those to do without."""
        self._without = without
        self._config = config
        self._is_networked = config.is_networked
        self._t0_ns = self._now_ns = self.due_ns = t0_ns
        self._target = Address(config.sysid, DRONE_COMPONENT)
        self._codec = Codec(Address(config.sysid, BRIDGE_COMPONENT))
        self._from_ground = FrameCutter()
        self._autopilots_name = Codec(self._target)
        stale_s = 0.0 if "stream-stale" in without else config.stale_setpoint_s
        self._takeover = Takeover(stale_s, None if "own-land" in without else config.stale_land_s)
        self._table: AutopilotTable | None = None
        self._lacks_origin = False
        self._received_ns = t0_ns
        self._beat_ns = t0_ns
        signatures = tuple(row for row in SIGNATURES if MONITOR_OF[row.trigger] not in without)
        configured = profile(config.profile, config.profiles)
        self._setpoints = BodySetpoints(
            config.sysid, configured.rate_max_rad_s, t0_ns, self._takeover.stream, self._without
        )
        self._estimate = BodyEstimate(configured, config.sysid, signatures)
        self._watches_attitude = "motor-failure" not in without
        self._hold = BodyHold(self._estimate)
        self._hold_ns = t0_ns
        self._inertial = InertialStream(self._target, config.inertial_rate_hz, self._estimate, t0_ns)
        self._feed = BodyFeed(config.body_name, self._estimate, t0_ns)
        self._age_due_ns = t0_ns
        self._strangers: set[int] = set()
        self._intercepted: dict[Address, int] = {}
        """How many frames of each sender on the autopilot's link ended here, less those that were added in its name: by
        sequence numbers the ground must miss none."""
        self._passed_seq: int | None = None
        """The sequence number of the autopilot's newest frame, as the ground has it."""
        self._rate_offset_reported = False
        self._to_ground: list[bytes] = []
        self._to_autopilot: list[Frame] = []
        self._events: list[Event] = []

    def receive_ground(self, datagram: Datagram, now_ns: int) -> None:
        """Pass what the ground says on to the autopilot, reading what matters."""
        self._now_ns = now_ns
        for frame in self._from_ground.cut(datagram.data):
            if self._is_networked:
                reject_reason = list_reject_reason(frame, self._config.sysid, armed=self._takeover.armed)
                if reject_reason:
                    self._setpoints.rejections.note(frame.source.words, reject_reason, now_ns)
                    continue
            if frame.number in POSES:
                ends = bool(self._feed.fault) or self._feed.fresh(now_ns)
            elif frame.number in SETPOINTS:
                ends = self._filter_setpoint(frame, now_ns)
            else:
                ends = self._ends(FROM_GROUND, frame)
            if not ends:
                self._to_autopilot.append(frame)
        self._update_due()

    def receive_autopilot(self, frames: Iterable[Frame], now_ns: int) -> None:
        """Pass the autopilot's frames on to the ground, reading what matters."""
        self._now_ns = now_ns
        for frame in frames:
            ended = self._intercepted.get(frame.source, 0)
            is_stranger = frame.source.system != self._config.sysid
            if is_stranger:
                self._note_stranger(frame.source.system)
            if is_stranger or self._ends(FROM_AUTOPILOT, frame):
                self._intercepted[frame.source] = ended + 1
            else:
                self._to_ground.append(renumbered(frame, frame.seq - ended) if ended else frame.data)
                if frame.source == self._target:
                    self._passed_seq = frame.seq - ended
        self._update_due()

    def receive_frame(self, frame: LabFrame, now_ns: int) -> None:
        """Send the autopilot the pose of its body, and hold the body while that pose is faulty."""
        self._now_ns = now_ns
        pose = self._feed.receive_frame(frame, now_ns, armed=self._takeover.armed)
        if self._feed.fresh(now_ns):
            self._takeover.rest(now_ns, still=self._hold.update_rest(now_ns, armed=self._takeover.armed))
        self._act_on_faults()
        if pose is not None:
            self._send_autopilot(pose)
        self._update_due()

    def tick(self, now_ns: int) -> GuardOutgoing:
        """Everything to send now."""
        self._now_ns = now_ns
        if now_ns >= self._beat_ns:
            self._beat_ns = now_ns + _BEAT_NS
            self._send_autopilot(_HEARTBEAT)
            self._send_ground(TimeSync(0, now_ns))
            self._send_ground(self._estimate.status(now_ns))
            if self._lacks_origin and self._feed.begun:
                self._send_autopilot(SetOrigin(self._config.sysid, *self._config.origin))
            asks = self._inertial.due(now_ns) if self._table is not None else None
            if asks is not None:
                self._send_autopilot(asks)
            if self._inertial.is_missing_report_due(now_ns):
                self._report(Severity.NOTICE, LACKS)
        if self._table is not None and now_ns >= self._inertial.sync.next_ns:
            asks_clock = self._inertial.sync.due(now_ns)
            if asks_clock is not None:
                self._send_autopilot(asks_clock)
        turn_ns = self._takeover.deadline_ns()
        if turn_ns is not None and turn_ns <= now_ns:
            # A PX4 that lands without poses flies at 0.4 m/s sideways: its estimate drifts, a level attitude does not.
            # But only an accelerometer brakes the body before; without one the autopilot's barometer lands it better.
            alone = bool(self._feed.fault) and self._estimate.measures_force
            self._act(self._takeover.due(now_ns, fed=self._feed.fresh(now_ns), down=self._hold.is_down, alone=alone))
            turn_ns = self._takeover.deadline_ns()
        for event in self._setpoints.due_events(now_ns):
            self._report(event.severity, f"{event.text} (from {event.source})")
        to_ground = datagrams(self._config.sysid, self._to_ground) if self._to_ground else ()
        innovations = self._estimate.pop_innovations(now_ns)
        outgoing = GuardOutgoing(to_ground, self._to_autopilot, self._events, innovations, self._estimate.faults)
        self._to_ground, self._to_autopilot, self._events, self._estimate.faults = [], [], [], []
        self.due_ns = self._beat_ns if turn_ns is None else min(self._beat_ns, turn_ns)
        return outgoing

    @property
    def has_autopilot(self) -> bool:
        """Whether a heartbeat of the drone's autopilot has come."""
        return self._table is not None

    @property
    def has_pose(self) -> bool:
        """Whether the mocap has shown the body."""
        return self._feed.begun

    def _update_due(self) -> None:
        """After every input: when `tick` is due if nothing arrives."""
        if self._to_ground or self._to_autopilot or self._events:
            self.due_ns = self._now_ns
            return
        takeover_ns = self._takeover.deadline_ns()
        self.due_ns = self._beat_ns if takeover_ns is None else min(self._beat_ns, takeover_ns)

    def _ends(self, table: "Mapping[int, _Handler]", frame: Frame) -> bool:
        """Whether a frame ends here, by the table of the side that it comes from; what the table has not passes."""
        handler = table.get(frame.number)
        if handler is None:
            return False
        try:
            message = read_message(frame)
        except MavlinkError:
            return False
        if isinstance(message, UnknownMessage):  # an IMU's sample without what is read of it
            return False
        return handler(self, frame.source, message)

    def _filter_setpoint(self, frame: Frame, now_ns: int) -> bool:
        """Pass on a setpoint that is obeyed, within bounds."""
        setpoints, source = self._setpoints, frame.source
        sender = setpoints.setpoint_filter.sender(source)
        self._report_age(sender, frame, now_ns)
        filtered = setpoints.filter(frame, sender, now_ns)
        if filtered.passed is None:
            return True
        stream = self._takeover.stream
        back = filtered.target is not None and stream.follow(source, now_ns)
        if filtered.target is not None and stream.broken:
            return True
        self._to_autopilot.append(filtered.passed)
        if sender.asks(now_ns):
            self._send_ground(TimeSync(0, now_ns))
        if stream.stage is Stage.FOLLOW and sender.is_age_unknown():
            self._report(Severity.INFO, f"Age of setpoints of {source.words} unknown: no TIMESYNC")
        if filtered.target is not None:
            self._hold.note(filtered.target, now_ns)
            self._note_command(filtered.target.thrust_norm, filtered.target.q_lab_from_flu)
        if back:
            self._report(*BACK)
        return True

    def _read_command(self, source: Address, message: CommandLong | CommandInt) -> bool:
        """A command ends here with this process's own answer, or may change the mode."""
        handler = _COMMANDS.get(message.command)
        answer = None if handler is None else handler(self, source, message)
        if answer is not None:
            self._answer(source, message.command, answer)
        elif message.command in SETS_MODE:
            self._mode_unknown()
        return answer is not None

    def _operator_control(self, source: Address, message: CommandLong | CommandInt) -> Result:
        stage = self._takeover.hand_over(source, message.params[1] == 1.0, self._now_ns)
        if stage is Stage.HOLD:
            self._report(*NEW_OWNER)
            self._hold.begin(self._now_ns)
        return Result.ACCEPTED

    def _message_interval(self, _source: Address, message: CommandLong | CommandInt) -> Result | None:
        ours = isinstance(message, CommandLong) and self._inertial.requested(message)
        return Result.ACCEPTED if ours else None

    def _land_command(self, _source: Address, _message: CommandLong | CommandInt) -> Result | None:
        """Land the body here where its poses are faulty: this process brakes by an estimate from before the fault."""
        stage = self._takeover.stream.stage
        own = self._takeover.descends_alone if stage is Stage.DESCEND else bool(self._feed.fault)
        if not own or not self._takeover.on_fault(Trigger.LAND_COMMAND, self._now_ns):
            return None
        if stage is Stage.HOLD:
            self._report(*LANDS_ITSELF)
        return Result.ACCEPTED

    def _arm_or_stop(self, _source: Address, message: CommandLong | CommandInt) -> Result | None:
        action, force = message.params[0], message.params[1]
        if action == 1.0 and self._takeover.stream.stage is Stage.STOPPED:
            self._takeover.stop(self._now_ns)  # who goes on asking as before the stop does not know of it
            self._report(Severity.CRITICAL, f"Arm refused: {STOPPED}")
            return Result.TEMPORARILY_REJECTED
        self._latch_stop(action == 0.0 and force == DISARM_IN_FLIGHT)
        return None

    def _terminate(self, _source: Address, message: CommandLong | CommandInt) -> None:
        self._latch_stop(message.params[0] > 0.5)

    def _latch_stop(self, stops: bool) -> None:
        if stops and "stop-latch" not in self._without:
            self._takeover.stop(self._now_ns)

    def _read_set_mode(self, _source: Address, _message: SetMode) -> bool:
        self._mode_unknown()
        return False

    def _read_ground_clock(self, source: Address, message: TimeSync) -> bool:
        if message.target.component != BRIDGE_COMPONENT or not message.tc1_ns:
            return False
        clock = self._setpoints.setpoint_filter.sender(source).clock
        clock.exchange(message.ts1_ns - self._t0_ns, message.tc1_ns, self._now_ns - self._t0_ns)
        return True

    def _answer(self, source: Address, command: int, result: Result) -> None:
        """In the autopilot's name, to which the command was sent, and with its next sequence number."""
        frames = self._autopilots_name.frames(CommandAck(source, command, result))
        if self._passed_seq is None:
            self._to_ground += [frame.data for frame in frames]
            return
        for frame in frames:
            self._passed_seq += 1
            self._to_ground.append(renumbered(frame, self._passed_seq))
            self._intercepted[self._target] = self._intercepted.get(self._target, 0) - 1

    def _note_stranger(self, system: int) -> None:
        """A frame of the autopilot's link is another system's; each of them is reported once."""
        if system not in self._strangers:
            self._strangers.add(system)
            self._report(Severity.ERROR, f"The autopilot says it is system {system}, not {self._config.sysid}")

    def _read_origin(self, _source: Address, _message: Origin) -> bool:
        self._lacks_origin = False
        return False

    def _read_ack(self, _source: Address, message: CommandAck) -> bool:
        if message.target.component == BRIDGE_COMPONENT:
            self._takeover.acknowledged(message)
            self._inertial.answered(message)
            return True
        if message.command in SETS_MODE:
            # Its next heartbeat by itself may be a second away, and until it is here nothing is guarded.
            self._send_autopilot(command_long(self._target, MavCommand.REQUEST_MESSAGE, float(MessageId.HEARTBEAT)))
        return False

    def _read_sample(self, _source: Address, message: InertialSample) -> bool:
        self._inertial.receive_sample(message, self._now_ns)
        self._feed.check()
        self._act_on_faults()
        return not self._inertial.passes

    def _read_attitude(self, _source: Address, message: AttitudeQuaternion) -> bool:
        self._inertial.receive_attitude(message, self._now_ns)
        self._feed.check()
        self._act_on_faults()
        return False

    def _read_autopilot_clock(self, source: Address, message: TimeSync) -> bool:
        if not message.tc1_ns:
            # Its poses come from here, so the clock it holds them against must be ours.
            stamp_ns = max(self._now_ns, 1)  # zero would be a request
            self._send_autopilot(TimeSync(stamp_ns, message.ts1_ns, source))
            return True
        ours = self._inertial.sync.answers(message)
        self._inertial.sync.receive(message, self._now_ns)
        self._report_rate_offset()
        return ours

    def _read_heartbeat(self, source: Address, beat: Heartbeat) -> bool:
        table = next((table for table in _TABLES if table.is_of(beat)), None)
        if table is None or source.component != DRONE_COMPONENT:
            return False
        silent_ns, self._received_ns = self._now_ns - self._received_ns, self._now_ns
        if self._table is not table or silent_ns > _SILENT_NS:
            self._lacks_origin = table.needs_origin
            self._inertial.restarted(self._now_ns, table.inertial_delay_s)
        if self._table is not table:
            self._table = table
            self._report(Severity.INFO, f"Bridge to {table.name.lower()}")
        offboard = table.mode_of(beat.custom_mode) in STREAM_MODES
        self._takeover.saw(self._now_ns, armed=beat.armed, offboard=offboard)
        if not self._takeover.is_flown_by_setpoints:
            self._note_command(math.nan)
        return False

    def _act(self, turn: Turn) -> None:
        """Carry out what the fail-safe asks for."""
        for stage in turn.begun:
            if stage is Stage.HOLD:
                self._hold.begin(self._now_ns)
            elif stage is Stage.DESCEND:
                self._feed.withhold()
            if stage is not Stage.HOLD or self._takeover.stream.reports_hold:
                self._report(*REPORTS[stage])
        if turn.flown is not None:
            self._fly(down=turn.flown is not Stage.HOLD, open_loop=turn.flown is Stage.DESCEND)
        if turn.stops:
            off = command_long(self._target, MavCommand.COMPONENT_ARM_DISARM, 0.0, DISARM_IN_FLIGHT)
            self._send_autopilot(off)
        if turn.lands:
            self._send_autopilot(command_long(self._target, MavCommand.NAV_LAND, 0.0, 0.0, 0.0, float("nan")))
        if turn.lands and self._hold.is_down:  # refused in the air
            self._send_autopilot(command_long(self._target, MavCommand.COMPONENT_ARM_DISARM))

    def _act_on_faults(self) -> None:
        """Hold a body whose poses are faulty, land one whose thrust is missing, stop one that nobody holds any more."""
        now_ns, fault = self._now_ns, self._feed.fault
        self._setpoints.pose_rejected = bool(fault)
        if fault and self._takeover.on_fault(Trigger.POSE_FAULT, now_ns):
            self._report(*pose_fault(fault))
            self._hold.begin(now_ns)
        if self._estimate.is_thrust_lost(now_ns) and self._takeover.on_fault(Trigger.THRUST_LOSS, now_ns):
            self._report(*THRUST_LOSS)
            self._hold.begin(now_ns)
        lost = self._watches_attitude and self._estimate.is_attitude_lost(now_ns)
        if lost and self._takeover.on_fault(Trigger.ATTITUDE_LOSS, now_ns):
            self._report(*ATTITUDE_LOSS)

    def _fly(self, *, down: bool, open_loop: bool) -> None:
        """One attitude target of our own."""
        dt_s = min(self._now_ns - self._hold_ns, 5 * STEP_NS) * 1e-9
        self._hold_ns = self._now_ns
        wanted = self._hold.descend_open_loop(dt_s) if open_loop else self._hold.step(self._now_ns, dt_s, down=down)
        t_boot_ms = self._now_ns // 1_000_000 % 2**32  # on the clock of our answers to TIMESYNC
        rate, thrust = np.zeros(3), wanted.thrust_norm
        self._note_command(thrust, wanted.q_lab_from_flu)
        self._send_autopilot(
            AttitudeSetpoint(self._target, t_boot_ms, wanted.q_lab_from_flu, rate, thrust, Ignore.BODY_RATES)
        )

    def _mode_unknown(self) -> None:
        """The ground sent a command that may change mode or arming."""
        self._takeover.mode_unknown()
        self._note_command(math.nan)

    def _note_command(self, thrust_norm: float, q_lab_from_flu: Quat | None = None) -> None:
        """A commanded thrust, which carries the body where the autopilot follows it and no floor does.

        An autopilot that gets no poses may fly by itself. Without an accelerometer the command is all there is.
        """
        followed = not (self._feed.fault and self._estimate.measures_force)
        known = self._takeover.is_flown_by_setpoints and followed
        thrust = thrust_norm if known and not self._feed.stands else math.nan
        self._estimate.receive_command(self._now_ns, thrust, q_lab_from_flu if known else None)

    def _report_age(self, sender: Sender, frame: Frame, now_ns: int) -> None:
        rate_hz = self._config.age_rate_hz
        if rate_hz <= 0.0 or now_ns < self._age_due_ns:
            return
        age_ms = sender.clock.age_ms(stamp_ms(frame), now_ns - self._t0_ns)
        if age_ms is not None:
            self._age_due_ns = max(self._age_due_ns + round(1e9 / rate_hz), now_ns)
            self._send_ground(NamedValue((now_ns - self._t0_ns) // 1_000_000, "age_ms", age_ms))

    def _report_rate_offset(self) -> None:
        """Name an autopilot's clock that runs at another rate, once."""
        rate_offset = self._inertial.sync.rate_offset
        if rate_offset is not None and not self._rate_offset_reported:
            self._rate_offset_reported = True
            self._report(Severity.WARNING, f"Autopilot's {rate_offset_text(rate_offset)}")

    def _report(self, severity: Severity, text: str) -> None:
        self._send_ground(StatusText(severity, text))
        self._events.append(Event(severity, f"uav{self._config.sysid}", text))

    def _send_ground(self, message: LinkMessage) -> None:
        self._to_ground.append(self._codec.encode(message))

    def _send_autopilot(self, message: LinkMessage) -> None:
        self._to_autopilot += self._codec.frames(message)


_Handler = Callable[[GuardCore, Address, Any], bool]
FROM_GROUND: Mapping[int, _Handler] = {
    MessageId.COMMAND_LONG: GuardCore._read_command,
    MessageId.COMMAND_INT: GuardCore._read_command,
    MessageId.SET_MODE: GuardCore._read_set_mode,
    MessageId.TIMESYNC: GuardCore._read_ground_clock,
}
"""By message id, beside setpoints and poses: acts on a message, and returns whether its frame ends here."""
FROM_AUTOPILOT: Mapping[int, _Handler] = {
    MessageId.HEARTBEAT: GuardCore._read_heartbeat,
    MessageId.GPS_GLOBAL_ORIGIN: GuardCore._read_origin,
    MessageId.COMMAND_ACK: GuardCore._read_ack,
    MessageId.HIGHRES_IMU: GuardCore._read_sample,
    MessageId.ATTITUDE_QUATERNION: GuardCore._read_attitude,
    MessageId.TIMESYNC: GuardCore._read_autopilot_clock,
}
"""The same of the autopilot's side."""
_COMMANDS: Mapping[int, Callable[[GuardCore, Address, CommandLong | CommandInt], Result | None]] = {
    MavCommand.REQUEST_OPERATOR_CONTROL: GuardCore._operator_control,
    MavCommand.SET_MESSAGE_INTERVAL: GuardCore._message_interval,
    MavCommand.NAV_LAND: GuardCore._land_command,
    MavCommand.COMPONENT_ARM_DISARM: GuardCore._arm_or_stop,
    MavCommand.DO_FLIGHTTERMINATION: GuardCore._terminate,
}
"""By their numbers the commands that the guard acts on: its own answer to one, or None where the autopilot answers."""


def warm_up() -> None:
    """Compile what every guard calls, before any motor turns: nothing compiles in flight."""
    position.warm_up()
    estimate.warm_up()
