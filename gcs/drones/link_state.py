"""One drone as its link shows it: what it last said, its clock, losses, parameters and commands. No policy here.

One more MAVLink message that the ground reads: its class in wire.link_messages, its codec in wire.mavlink.messages, its
id in gcs.drones.telemetry.READS, and a case of `DroneLink._read`. One that it sends: from `DroneLink.due`.
"""

import math
from collections import deque
from typing import NamedTuple

from formation.config import VehicleBody
from formation.messages import FORCE_MOST_M_S2, Event, Severity
from formation.model import Vec3Tuple
from formation.safety.rules_table import SILENT_S
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
    Reports,
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

RESTART_NS = 2_500_000_000  # without a heartbeat: it may have restarted and lost its stream requests
ORIGIN_NS = 1_000_000_000
AGE_FRESH_NS = 1_000_000_000
BEHIND_FRESH_NS = 100_000_000
GUARD_NS = 10_000_000_000
CLOCK_DRIFT_WARN_NS = 60_000_000_000


class Ages(NamedTuple):
    """Seconds; infinite before the first, NaN where it is not known.

    heartbeat_s, silent_s: since its last heartbeat, and since anything valid was heard of it. behind_s: how old its
    newest telemetry was when it was read, by the drone's own clock: what waited in a queue on the way, or here. NaN
    where nothing stamped came just now: one late message before a pause, as of a machine that stalled, is no backlog,
    of which all that comes is late. setpoint_s: how old setpoints are when they reach it, camera to drone.
    """

    heartbeat_s: float
    silent_s: float
    behind_s: float
    setpoint_s: float


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
        self._origin_sent_ns = self._clock_drift_warned_ns = NEVER_NS
        self.target = Address(sysid, DRONE_COMPONENT)
        self.codec = Codec(own, reads=READS | (READS_IF_ASKED & dict(streams).keys()))
        self.telemetry = Telemetry()
        self.own_estimate = OwnEstimate()
        self.armed = self.offboard = False
        """Whether its last heartbeat said armed, and that it follows our setpoints."""
        self.model: GroundModel | None = None
        self.setpoint_ignore = int(Ignore.BODY_RATES)
        """The type mask of its setpoints."""
        self.hover_thrust_norm = profile.hover_thrust_norm
        """Thrust that hovers: the autopilot's own parameter where it was measured, else the profile's."""
        self.armed_clock = ArmedClock()
        self.commands = CommandChannel()
        self.clock = TimeSyncClient(self.target)
        self.sequence = SequenceMonitor()
        self.parameters = ParameterReader(self.target, MavAutopilot.GENERIC)
        self.boot_parameters = BootParameters()
        self.reports = Reports(self.name)
        self.answers: deque[LinkMessage] = deque(maxlen=2)
        """Answers to it that should not wait for the next frame."""

    def ages(self, now_ns: int) -> Ages:
        """How old what was heard of it is now."""
        newest = self.telemetry
        return Ages(
            math.inf if newest.heartbeat is None else (now_ns - newest.heartbeat_ns) * 1e-9,
            math.inf if newest.received_ns == NEVER_NS else (now_ns - newest.received_ns) * 1e-9,
            newest.behind_s if now_ns - newest.behind_ns <= BEHIND_FRESH_NS else math.nan,
            newest.setpoint_age_s if now_ns - newest.setpoint_age_ns <= AGE_FRESH_NS else math.nan,
        )

    def answers_other_ground(self, now_ns: int) -> bool:
        """Whether it was lately heard to answer another ground than this."""
        return now_ns - self.telemetry.other_ground_ns < round(SILENT_S * 1e9)

    @property
    def events(self) -> list[Event]:
        """The events about it that are not handed on yet."""
        return self.reports.events

    @property
    def foreign_sysid(self) -> int | None:
        """The system id of another drone that speaks on its link; None where there is none."""
        return self.telemetry.foreign_sysid

    @property
    def piloted(self) -> bool:
        """Whether its last heartbeat said that a person flies it: armed, in a mode that is a pilot's."""
        heartbeat, model = self.telemetry.heartbeat, self.model
        if self.offboard or heartbeat is None or model is None or not self.armed:
            return False
        if self.telemetry.mode not in PILOTED:
            return False
        return model.table.split(heartbeat.custom_mode)[0] != model.table.auto_main  # PX4 holds by itself

    @property
    def landing(self) -> bool:
        """Whether its last heartbeat said that it lands by itself."""
        return self.telemetry.mode in (FlightMode.LAND, FlightMode.DESCEND)

    @property
    def mode(self) -> str:
        """Its mode in its autopilot's own word."""
        heartbeat = self.telemetry.heartbeat
        return "-" if heartbeat is None or self.model is None else self.model.table.mode_name(heartbeat.custom_mode)

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
        back_ns = self.boot_parameters.back_ns
        return by_clock_ns if back_ns is None else max(back_ns, by_clock_ns or back_ns)

    @property
    def awaiting_restart(self) -> tuple[str, ...]:
        """Parameters that are as wanted by now and count from a boot that is still to come."""
        return self.boot_parameters.awaiting(self.booted_ns, self.parameters.values, self.model)

    def receive(self, data: bytes, now_ns: int, superseded: int = 0) -> None:
        """Take in one datagram; what cannot be read, or is not from this drone's autopilot, is counted.

        superseded: packets before it that its link dropped unread.
        """
        if superseded:
            self.sequence.skip(superseded)
        for packet in self.codec.receive(data):
            if packet.source == (self.sysid, BRIDGE_COMPONENT):
                self._read_bridge(packet.message, now_ns)
            if packet.source.component != DRONE_COMPONENT:
                continue
            if packet.source.system != self.sysid:
                if packet.source.system != self.telemetry.foreign_sysid:
                    self.telemetry.foreign_sysid = packet.source.system
                    text = f"drone {packet.source.system} answers on the link of drone {self.sysid}"
                    self.reports.add(Severity.ERROR, text, now_ns)
                continue
            self.telemetry.received_ns = now_ns
            self.sequence.note(packet.seq, now_ns, self.codec.misaddressed_packets)
            self._read(packet.message, now_ns)
        if self.codec.overheard is not None:
            self._overhear(self.codec.overheard, now_ns)
            self.codec.overheard = None

    def due(self, now_ns: int) -> list[LinkMessage]:
        """Answers, time sync, commands and parameter requests to send now."""
        messages: list[LinkMessage] = []
        if self.answers:
            messages += self.answers
            self.answers.clear()
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
        origin, model = self._origin, self.model
        if (  # every second until the drone has repeated it or is ready without
            origin is not None and model is not None and model.table.needs_origin and not self.telemetry.origin
            and now_ns - self._origin_sent_ns >= ORIGIN_NS and model.unready(self.telemetry)
        ):  # fmt: skip
            self._origin_sent_ns = now_ns
            messages.append(SetOrigin(self.sysid, *origin))
        return messages

    def reread_parameters(self) -> None:
        """Ask again for everything that matters before arming."""
        if self.model is not None:
            self.parameters.ask(self.model.parameters)

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
                    self.answers.append(command_long(self.target, MavCommand.REQUEST_MESSAGE, heartbeat))
            case TimeSync():
                if message.tc1_ns:
                    self._overhear(message.target, now_ns)
                answer = self.clock.receive(message, now_ns)
                self._report_clock_drift(now_ns)
                self.answers.extend(() if answer is None else (answer,))
            case ParamValue():
                reason = self.parameters.receive(message, self.armed)
                self._update_hover_thrust()
                if reason:
                    self.reports.rejections.note(self.name, reason, now_ns)
                elif self.model is not None:
                    name, value = message.name, self.parameters.values[message.name]
                    self.boot_parameters.read(name, value, self.model, now_ns)
            case AttitudeQuaternion():
                t_ns = self._made_ns(message.t_boot_ms * 1_000_000, now_ns)
                self.own_estimate.receive_attitude(message.q_lab_from_flu, NEVER_NS if t_ns is None else t_ns)
            case InertialSample():
                t_ns = self._made_ns(message.t_boot_us * 1000, now_ns)
                if t_ns is not None and not self.telemetry.force.receive(t_ns, message.specific_force_flu_m_s2, now_ns):
                    reason = f"specific force beyond {FORCE_MOST_M_S2 / GRAVITY_M_S2:.0f} g"
                    self.reports.rejections.note(self.name, reason, now_ns)
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
                self.telemetry.battery_v, self.telemetry.drop_rate = message.battery_v, message.drop_rate
                self.telemetry.sensors_unhealthy = message.sensors_enabled & ~message.sensors_healthy
            case EkfStatus():
                self.telemetry.estimator = message
            case Origin():
                self.telemetry.origin = True
            case NamedValue(name="age_ms"):
                self.telemetry.setpoint_age_s, self.telemetry.setpoint_age_ns = message.value * 1e-3, now_ns
            case StatusText():
                self.reports.texts.append(message.text)
                self.reports.add(message.severity, message.text, now_ns)

    def _report_clock_drift(self, now_ns: int) -> None:
        """Report a clock that drifts against ours, at most once a minute."""
        drift = self.clock.rate_offset
        if drift is not None and now_ns - self._clock_drift_warned_ns >= CLOCK_DRIFT_WARN_NS:
            self._clock_drift_warned_ns = now_ns
            self.reports.add(Severity.WARNING, rate_offset_text(drift), now_ns)

    def _made_ns(self, stamp_ns: int, now_ns: int) -> int | None:
        """The time of a stamp of the drone on our clock; None before its clock offset is known. Each stamped message
        also updates the age of the link's telemetry."""
        age_ns = self.clock.clock.lag_ns(stamp_ns, now_ns)
        if age_ns is None:
            return None
        self.telemetry.behind_s, self.telemetry.behind_ns = max(age_ns, 0) * 1e-9, now_ns
        return now_ns - age_ns

    def _read_bridge(self, message: LinkMessage, now_ns: int) -> None:
        """The bridge beside the autopilot: it asks for our clock, and reports its events and the age of setpoints."""
        match message:
            case TimeSync(tc1_ns=0):
                self.answers.append(TimeSync(now_ns, message.ts1_ns, Address(self.sysid, BRIDGE_COMPONENT)))
            case NamedValue() | StatusText():
                self._read(message, now_ns)
        if isinstance(message, StatusText):
            warns, first = message.severity <= Severity.WARNING, self.guard_words(now_ns)
            self.telemetry.guard_text, self.telemetry.guard_ns = (first or message.text) if warns else "", now_ns

    def guard_words(self, now_ns: int) -> str:
        """The first of the guard's warnings, where it has warned of late; else the empty text."""
        return self.telemetry.guard_text if now_ns - self.telemetry.guard_ns < GUARD_NS else ""

    def _receive_heartbeat(self, heartbeat: Heartbeat, now_ns: int) -> None:
        silent_ns, self.telemetry.heartbeat_ns = now_ns - self.telemetry.heartbeat_ns, now_ns
        self.telemetry.heartbeat, self.armed = heartbeat, heartbeat.armed
        self.armed_clock.receive_heartbeat(heartbeat.armed, now_ns)
        known = next((model for model in GROUND_MODELS.values() if model.table.is_of(heartbeat)), None)
        model = known or self.model
        self.telemetry.mode = None if model is None else model.table.mode_of(heartbeat.custom_mode)
        self.offboard = self.telemetry.mode is FlightMode.OFFBOARD
        if known is None or (known is self.model and silent_ns < RESTART_NS):
            return
        if known is self.model:
            self.boot_parameters.back_ns = now_ns
        else:
            self.model, self.parameters = known, ParameterReader(self.target, known.table.autopilot)
            self.setpoint_ignore = int(known.setpoint_ignore(self.profile))
            self._update_hover_thrust()
        self.telemetry.origin = False
        self.reread_parameters()
        self.telemetry.force.asked_ns = now_ns
        silenced = dict.fromkeys(known.unread, 0.0) if self._own_link else {}
        for message_id, rate_hz in {**silenced, **dict(known.streams), **dict(self._streams)}.items():
            self.commands.ask(stream(self.target, message_id, rate_hz))
        self.reports.add(Severity.INFO, f"drone {self.sysid} is here, {known.name}", now_ns)

    def _update_hover_thrust(self) -> None:
        known = None if self.model is None else self.parameters.values.get(self.model.table.hover_parameter)
        measured = known is not None and self.model is not None and self.model.hover_measured(known)
        self.hover_thrust_norm = known if measured and known is not None else self.profile.hover_thrust_norm

    def _watch_imu_stream(self, now_ns: int) -> None:
        """Report when the requested HIGHRES_IMU stream is missing, and when it is back."""
        if self.model is None or not READS_IF_ASKED & dict(self._streams).keys():
            return
        force = self.telemetry.force
        silent = now_ns - max(force.asked_ns, force.received_ns) > round(SILENT_S * 1e9)
        if silent and not force.is_missing:
            self.reports.add(Severity.WARNING, "sends no HIGHRES_IMU that was asked for: flown without", now_ns)
        elif force.is_missing and not silent:
            self.reports.add(Severity.INFO, "sends HIGHRES_IMU", now_ns)
        force.is_missing = silent

    def _overhear(self, other: Address | None, now_ns: int) -> None:
        """Detect that it answers another ground, by the address of one of its answers."""
        if other is None or other == self.codec.own or other.system != GROUND_SYSTEM:
            return
        if other.component in GROUND_COMPONENTS:
            self.telemetry.other_ground_ns = now_ns


def _fraction(remaining: float) -> float:
    return remaining if 0.0 <= remaining <= 1.0 else math.nan
