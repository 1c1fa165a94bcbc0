"""One drone as its link shows it: what it last said, its clock, losses, parameters and commands. No policy here."""

import math
from collections import deque

from formation.config import VehicleBody
from formation.maths.arrays import Quat
from formation.messages import FORCE_MOST_M_S2, Event, Severity
from formation.model import Vec3Tuple
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from gcs.drones.autopilot_model import GROUND_MODELS, GroundModel
from gcs.drones.protocols import BootParameters, CommandChannel, ParameterReader, stream
from gcs.drones.telemetry import (
    NEVER_NS,
    PILOTED,
    READS,
    READS_IF_ASKED,
    ArmedClock,
    OwnEstimate,
    SequenceMonitor,
    Telemetry,
)
from wire.autopilots.table import FlightMode
from wire.clock_offset import TimeSyncClient, rate_offset_text
from wire.link_messages import (
    BRIDGE_COMPONENT,
    DRONE_COMPONENT,
    GROUND,
    GROUND_COMPONENTS,
    GROUND_SYSTEM,
    Address,
    AttitudeQuaternion,
    Battery,
    CommandAck,
    EkfStatus,
    ExtendedSysState,
    Heartbeat,
    Ignore,
    InertialSample,
    LinkMessage,
    LocalPosition,
    MavAutopilot,
    MavCommand,
    MessageId,
    NamedValue,
    Origin,
    ParamValue,
    Result,
    SetOrigin,
    StatusText,
    SysStatus,
    TimeSync,
    command_long,
)
from wire.mavlink.codec import Codec
from wire.rejections import RejectionLog

RESTART_NS = 2_500_000_000  # without a heartbeat: it may have restarted and lost its stream requests
ORIGIN_NS = 1_000_000_000
WORDS_A_SECOND = 20
ANSWERS = 2
ATTITUDES = 8
OTHER_GROUND_S = 3.0
AGE_FRESH_NS = 1_000_000_000
BEHIND_FRESH_NS = 100_000_000
FORCE_LOST_NS = 3_000_000_000
GUARD_NS = 10_000_000_000
CLOCK_DRIFT_WARN_NS = 60_000_000_000


class DroneLink:
    """The ground's end of one drone's MAVLink. `receive` takes datagrams in, `due` says what to send now."""

    def __init__(
        self,
        body: VehicleBody,
        sysid: int,
        profile: VehicleProfile,
        streams: tuple[tuple[int, float], ...] = (),
        origin: Vec3Tuple | None = None,
        own: Address = GROUND,
    ) -> None:
        """own: who we are on it. streams: messages to ask for beside its autopilot model's, id and rate, Hz.

        origin: latitude, longitude (degrees) and altitude (m) to send to a drone that needs them; None without a mocap.
        """
        self.name = body.body
        self.sysid = sysid
        self.profile = profile
        self._own_link = body.link is not None
        self._streams = streams
        self._origin = origin
        self._origin_sent_ns = NEVER_NS
        self.target = Address(sysid, DRONE_COMPONENT)
        self._bridge = Address(sysid, BRIDGE_COMPONENT)
        self.codec = Codec(own, reads=READS | (READS_IF_ASKED & dict(streams).keys()))
        self.telemetry = Telemetry()
        self.own_estimate = OwnEstimate()
        self.armed = False
        """Whether its last heartbeat said armed."""
        self.heartbeat_ns = self.received_ns = NEVER_NS
        self._other_ground_ns = NEVER_NS
        self.model: GroundModel | None = None
        self.setpoint_ignore = int(Ignore.BODY_RATES)
        """The type mask of its setpoints."""
        self._flight_mode: FlightMode | None = None
        self.offboard = False
        """Whether its last heartbeat said that it follows our setpoints."""
        self.hover_thrust_norm = profile.hover_thrust_norm
        """Thrust that hovers: the autopilot's own parameter where it was measured, else the profile's."""
        self.armed_clock = ArmedClock()
        self.commands = CommandChannel()
        self.clock = TimeSyncClient(self.target)
        self.sequence = SequenceMonitor()
        self.parameters = ParameterReader(self.target, MavAutopilot.GENERIC)
        self.foreign_sysid: int | None = None
        self.texts: deque[str] = deque(maxlen=4)
        self.events: list[Event] = []
        self._reject_log = RejectionLog()
        self._second_ns, self._words = NEVER_NS, 0
        self._answers: deque[LinkMessage] = deque(maxlen=ANSWERS)
        self.attitudes: deque[tuple[int, Quat]] = deque(maxlen=ATTITUDES)
        """Its own attitude estimates since they were last cleared: times, ns, on our clock, and q_lab_from_flu."""
        self._guard_text, self._guard_ns = "", NEVER_NS
        self._misaddressed = 0
        self.superseded = 0
        self._back_ns: int | None = None
        """When it was back after a silence in which it may have restarted."""
        self._asked_ns, self._forceless = NEVER_NS, False
        self._behind_s, self._behind_ns = math.nan, NEVER_NS
        self._clock_drift_warned_ns = NEVER_NS
        self.boot_parameters = BootParameters()

    def ages_s(self, now_ns: int) -> tuple[float, float, float, float]:
        """`heartbeat_age_s`, `silent_s`, `behind_s` and `setpoint_age_s`, in one call a tick."""
        telemetry = self.telemetry
        return (
            math.inf if telemetry.heartbeat is None else (now_ns - self.heartbeat_ns) * 1e-9,
            math.inf if self.received_ns == NEVER_NS else (now_ns - self.received_ns) * 1e-9,
            self._behind_s if now_ns - self._behind_ns <= BEHIND_FRESH_NS else math.nan,
            telemetry.setpoint_age_s if now_ns - telemetry.setpoint_age_ns <= AGE_FRESH_NS else math.nan,
        )

    def heartbeat_age_s(self, now_ns: int) -> float:
        """Time since its last heartbeat, s; infinite before the first."""
        return self.ages_s(now_ns)[0]

    def silent_s(self, now_ns: int) -> float:
        """Time since anything valid was heard of it, s; infinite before the first."""
        return self.ages_s(now_ns)[1]

    def behind_s(self, now_ns: int) -> float:
        """How old its newest telemetry was when it was read, by the drone's own clock, s: what waited in a queue on the
        way, or here. NaN where its clock is not known, or nothing stamped came just now: one late message before a
        pause, as of a machine that stalled, is no backlog, of which all that comes is late."""
        return self.ages_s(now_ns)[2]

    def setpoint_age_s(self, now_ns: int) -> float:
        """How old setpoints are when they reach it, camera to drone, s; NaN where it has not said of late."""
        return self.ages_s(now_ns)[3]

    def answers_other_ground(self, now_ns: int) -> bool:
        """Whether it was lately heard to answer another ground than this."""
        return now_ns - self._other_ground_ns < round(OTHER_GROUND_S * 1e9)

    @property
    def piloted(self) -> bool:
        """Whether its last heartbeat said that a person flies it: armed, in a mode that is a pilot's."""
        heartbeat, model = self.telemetry.heartbeat, self.model
        if self.offboard or heartbeat is None or model is None or not self.armed:
            return False
        if self._flight_mode not in PILOTED:
            return False
        return model.table.split(heartbeat.custom_mode)[0] != model.table.auto_main  # PX4 holds by itself

    @property
    def landing(self) -> bool:
        """Whether its last heartbeat said that it lands by itself."""
        return self._flight_mode in (FlightMode.LAND, FlightMode.DESCEND)

    @property
    def mode(self) -> str:
        """Its mode in its autopilot's own word."""
        heartbeat = self.telemetry.heartbeat
        return "-" if heartbeat is None or self.model is None else self.model.table.mode_name(heartbeat.custom_mode)

    @property
    def has_answers(self) -> bool:
        """Whether something is waiting that should not wait for the next frame."""
        return bool(self._answers)

    @property
    def idle_disarm_s(self) -> float | None:
        """After how long it disarms by itself when armed without a take-off; the default until that was read."""
        if self.model is None:
            return None
        name, default_s = self.model.table.idle_disarm_parameter, self.model.idle_disarm_default_s
        timeout_s = self.parameters.values.get(name, default_s)
        return timeout_s if timeout_s > 0.0 else None

    @property
    def booted_ns(self) -> int | None:
        """When its autopilot booted, on our clock: by TIMESYNC, or when it was back after a silence: its clock may be
        that of the computer it runs on, which shows no restart. None before the first answer."""
        by_clock_ns = None if self.clock.offset_ns is None else -self.clock.offset_ns
        back_ns = self._back_ns
        return by_clock_ns if back_ns is None else max(back_ns, by_clock_ns or back_ns)

    @property
    def awaiting_restart(self) -> tuple[str, ...]:
        """Parameters that are as wanted by now and count from a boot that is still to come."""
        return self.boot_parameters.awaiting(self.booted_ns, self.parameters.values, self.model)

    def receive(self, data: bytes, now_ns: int, superseded: int = 0) -> None:
        """Take in one datagram; what cannot be read, or is not from this drone's autopilot, is counted.

        superseded: packets before it that its link dropped unread.
        """
        self.superseded += superseded
        for packet in self.codec.receive(data):
            if packet.source == self._bridge:
                self._read_bridge(packet.message, now_ns)
            if packet.source.component != DRONE_COMPONENT:
                continue
            if packet.source.system != self.sysid:
                self._detect_foreign_sysid(packet.source.system, now_ns)
                continue
            skipped, superseded = self.codec.misaddressed_packets - self._misaddressed + superseded, 0
            self._misaddressed = self.codec.misaddressed_packets
            self.received_ns = now_ns
            self.sequence.note(packet.seq, now_ns, skipped)
            self._read(packet.message, now_ns)
        if self.codec.overheard is not None:
            self._overhear(self.codec.overheard, now_ns)
            self.codec.overheard = None

    def due(self, now_ns: int) -> list[LinkMessage]:
        """Answers, time sync, commands and parameter requests to send now."""
        messages: list[LinkMessage] = []
        if self._answers:
            messages += self._answers
            self._answers.clear()
        if self._reject_log.has_pending:
            self.events += self._reject_log.due(now_ns)
        if now_ns >= self.clock.next_ns:
            request = self.clock.due(now_ns)
            if request is not None:
                messages.append(request)
        commands = self.commands
        if commands.current is not None or commands.queue:
            command = commands.due(now_ns)
            if command is not None:
                messages.append(command)
        if self.parameters.open:
            messages += self.parameters.due(now_ns)
        if self._origin is not None and not self.telemetry.origin:
            messages += self._due_origin(now_ns)
        return messages

    def reread_parameters(self) -> None:
        """Ask again for everything that matters before arming."""
        if self.model is not None:
            self.parameters.ask(self.model.parameters)

    def _due_origin(self, now_ns: int) -> list[LinkMessage]:
        """The origin, every second until the drone has repeated it or is ready without."""
        model = self.model
        if self._origin is None or model is None or not model.table.needs_origin or self.telemetry.origin:
            return []
        if now_ns - self._origin_sent_ns < ORIGIN_NS or not model.unready(self.telemetry):
            return []
        self._origin_sent_ns = now_ns
        return [SetOrigin(self.sysid, *self._origin)]

    def _read(self, message: LinkMessage, now_ns: int) -> None:
        match message:
            case Heartbeat():
                self._receive_heartbeat(message, now_ns)
                self._watch_imu_stream(now_ns)
            case CommandAck():
                if message.command == MavCommand.COMPONENT_ARM_DISARM and message.result is Result.ACCEPTED:
                    self.armed_clock.accept(now_ns)
                self.commands.receive(message, now_ns)
                if message.command == MavCommand.COMPONENT_ARM_DISARM and self.commands.urgent_ns is not None:
                    # Its heartbeat alone ends a motor cut; the next by itself may be a second away.
                    heartbeat = float(MessageId.HEARTBEAT)
                    self._answers.append(command_long(self.target, MavCommand.REQUEST_MESSAGE, heartbeat))
            case TimeSync():
                if message.tc1_ns:
                    self._overhear(message.target, now_ns)
                answer = self.clock.receive(message, now_ns)
                self._report_clock_drift(now_ns)
                self._answers.extend(() if answer is None else (answer,))
            case ParamValue():
                reason = self.parameters.receive(message, self.armed)
                self._update_hover_thrust()
                if reason:
                    self._reject_log.note(self.name, reason, now_ns)
                elif self.model is not None:
                    name, value = message.name, self.parameters.values[message.name]
                    self.boot_parameters.read(name, value, self.model, now_ns)
            case AttitudeQuaternion():
                t_ns = self._made_ns(message.t_boot_ms * 1_000_000, now_ns)
                self.own_estimate.receive_attitude(message.q_lab_from_flu, NEVER_NS if t_ns is None else t_ns)
                if t_ns is not None:
                    self.attitudes.append((t_ns, message.q_lab_from_flu))
            case InertialSample():
                t_ns = self._made_ns(message.t_boot_us * 1000, now_ns)
                if t_ns is not None and not self.telemetry.force.receive(t_ns, message.specific_force_flu_m_s2, now_ns):
                    self._reject_log.note(
                        self.name, f"specific force beyond {FORCE_MOST_M_S2 / GRAVITY_M_S2:.0f} g", now_ns
                    )
            case LocalPosition():
                t_ns = self._made_ns(message.t_boot_ms * 1_000_000, now_ns)
                self.own_estimate.receive_position(message.pos_lab_m, NEVER_NS if t_ns is None else t_ns)
            case ExtendedSysState():
                self.telemetry.landed = message.landed
            case Battery():
                self.telemetry.battery = _fraction(message.remaining)
                self.telemetry.battery_v = sum(message.cell_v)
            case SysStatus():
                self.telemetry.battery = _fraction(message.battery_remaining)
                self.telemetry.battery_v = message.battery_v
                self.telemetry.sensors_unhealthy = message.sensors_enabled & ~message.sensors_healthy
            case EkfStatus():
                self.telemetry.estimator = message
            case Origin():
                self.telemetry.origin = True
            case NamedValue(name="age_ms"):
                self.telemetry.setpoint_age_s, self.telemetry.setpoint_age_ns = message.value * 1e-3, now_ns
            case StatusText():
                self.texts.append(message.text)
                self._add_event(message.severity, message.text, now_ns)

    def _report_clock_drift(self, now_ns: int) -> None:
        """Report a clock that drifts against ours, at most once a minute."""
        drift = self.clock.rate_offset
        if drift is not None and now_ns - self._clock_drift_warned_ns >= CLOCK_DRIFT_WARN_NS:
            self._clock_drift_warned_ns = now_ns
            self._add_event(Severity.WARNING, rate_offset_text(drift), now_ns)

    def _made_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """The time of a stamp of the drone on our clock; None before its clock offset is known. Each stamped message
        also updates the age of the link's telemetry."""
        age_ns = self.clock.clock.lag_ns(stamp_ns, now_ns)
        if age_ns is None:
            return None
        self._behind_s, self._behind_ns = max(age_ns, 0) * 1e-9, now_ns
        return now_ns - age_ns

    def _read_bridge(self, message: LinkMessage, now_ns: int) -> None:
        """The bridge beside the autopilot: it asks for our clock, and reports its events and the age of setpoints."""
        match message:
            case TimeSync(tc1_ns=0):
                self._answers.append(TimeSync(now_ns, message.ts1_ns, self._bridge))
            case NamedValue() | StatusText():
                self._read(message, now_ns)
        if isinstance(message, StatusText):
            goes_on = self._guard_text and now_ns - self._guard_ns < GUARD_NS and message.severity <= Severity.WARNING
            first = self._guard_text if goes_on else message.text
            self._guard_text = first if message.severity <= Severity.WARNING else ""
            self._guard_ns = now_ns

    def guard_words(self, now_ns: int) -> str:
        """The first of the guard's warnings, where it has warned of late; else the empty text."""
        return self._guard_text if now_ns - self._guard_ns < GUARD_NS else ""

    def _receive_heartbeat(self, heartbeat: Heartbeat, now_ns: int) -> None:
        silent_ns, self.heartbeat_ns = now_ns - self.heartbeat_ns, now_ns
        self.telemetry.heartbeat, self.armed = heartbeat, heartbeat.armed
        self.armed_clock.receive_heartbeat(heartbeat.armed, now_ns)
        known = GROUND_MODELS.get(heartbeat.autopilot)
        model = known or self.model
        self._flight_mode = None if model is None else model.table.mode_of(heartbeat.custom_mode)
        self.offboard = self._flight_mode is FlightMode.OFFBOARD
        if known is None or (known is self.model and silent_ns < RESTART_NS):
            return
        if known is self.model:
            self._back_ns = now_ns
        else:
            self.model, self.parameters = known, ParameterReader(self.target, known.table.autopilot)
            self.setpoint_ignore = int(known.setpoint_ignore(self.profile))
            self._update_hover_thrust()
        self.telemetry.origin = False
        self.reread_parameters()
        self._asked_ns = now_ns
        silenced = dict.fromkeys(known.unread, 0.0) if self._own_link else {}
        for message_id, rate_hz in {**silenced, **dict(known.streams), **dict(self._streams)}.items():
            self.commands.ask(stream(self.target, message_id, rate_hz))
        self._add_event(Severity.INFO, f"drone {self.sysid} is here, {known.name}", now_ns)

    def _update_hover_thrust(self) -> None:
        known = None if self.model is None else self.parameters.values.get(self.model.table.hover_parameter)
        measured = known is not None and self.model is not None and self.model.hover_measured(known)
        self.hover_thrust_norm = known if measured and known is not None else self.profile.hover_thrust_norm

    def _watch_imu_stream(self, now_ns: int) -> None:
        """Report when the requested HIGHRES_IMU stream is missing, and when it is back."""
        if self.model is None or not READS_IF_ASKED & dict(self._streams).keys():
            return
        silent = now_ns - max(self._asked_ns, self.telemetry.force.received_ns) > FORCE_LOST_NS
        if silent and not self._forceless:
            self._add_event(Severity.WARNING, "sends no HIGHRES_IMU that was asked for: flown without", now_ns)
        elif self._forceless and not silent:
            self._add_event(Severity.INFO, "sends HIGHRES_IMU", now_ns)
        self._forceless = silent

    def _overhear(self, other: Address | None, now_ns: int) -> None:
        """Detect that it answers another ground, by the address of one of its answers."""
        if other is None or other == self.codec.own or other.system != GROUND_SYSTEM:
            return
        if other.component in GROUND_COMPONENTS:
            self._other_ground_ns = now_ns

    def _detect_foreign_sysid(self, system: int, now_ns: int) -> None:
        if system != self.foreign_sysid:
            self.foreign_sysid = system
            self._add_event(Severity.ERROR, f"drone {system} answers on the link of drone {self.sysid}", now_ns)

    def _add_event(self, severity: Severity, text: str, now_ns: int) -> None:
        """Add an event of this drone; beyond WORDS_A_SECOND events are counted only."""
        if now_ns - self._second_ns >= 1_000_000_000:
            self._second_ns, self._words = now_ns, 0
        self._words += 1
        if self._words > WORDS_A_SECOND:
            self._reject_log.note(self.name, f"texts beyond {WORDS_A_SECOND} a second", now_ns)
        else:
            self.events.append(Event(severity, self.name, text))


def _fraction(remaining: float) -> float:
    return remaining if 0.0 <= remaining <= 1.0 else math.nan
