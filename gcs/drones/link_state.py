"""One drone as its link shows it: what it last said, its clock, losses, parameters and commands. No policy here."""

import math
from collections import deque
from dataclasses import dataclass

from formation.config import VehicleBody
from formation.maths.arrays import Quat, Vec3
from formation.messages import Event, Severity
from formation.model import Vec3Tuple
from formation.vehicle.profile import VehicleProfile
from gcs.drones.armed_clock import ArmedClock
from gcs.drones.autopilot_model import GROUND_MODELS, GroundModel
from gcs.drones.commands import CommandChannel, stream
from gcs.drones.parameters import ParameterReader
from gcs.drones.sequence import SequenceMonitor
from gcs.drones.timesync import TimeSyncClient
from wire.autopilots.table import FlightMode
from wire.link_messages.address import BRIDGE_COMPONENT, DRONE_COMPONENT, GROUND, Address
from wire.link_messages.clocks import TimeSync
from wire.link_messages.commands import CommandAck, MavCommand, Result
from wire.link_messages.message_id import MessageId
from wire.link_messages.motion import Origin, SetOrigin
from wire.link_messages.packet import LinkMessage
from wire.link_messages.parameters import ParamValue
from wire.link_messages.setpoints import AttitudeSetpoint, Ignore
from wire.link_messages.status import (
    Battery,
    EkfStatus,
    ExtendedSysState,
    Heartbeat,
    LandedState,
    MavAutopilot,
    MavState,
    MavType,
    NamedValue,
    StatusText,
    SysStatus,
)
from wire.mavlink.codec import Codec
from wire.refusals import Refusals

NEVER_NS = -(10**18)
# What is acted on below. Poses and the rest, most of what a drone sends, are not even decoded.
READS = frozenset(
    {
        MessageId.HEARTBEAT,
        MessageId.SYS_STATUS,
        MessageId.PARAM_VALUE,
        MessageId.GPS_GLOBAL_ORIGIN,
        MessageId.COMMAND_ACK,
        MessageId.TIMESYNC,
        MessageId.BATTERY_STATUS,
        MessageId.EKF_STATUS_REPORT,
        MessageId.ESTIMATOR_STATUS,
        MessageId.EXTENDED_SYS_STATE,
        MessageId.NAMED_VALUE_FLOAT,
        MessageId.STATUSTEXT,
    }
)
RESTART_NS = 2_500_000_000  # without a heartbeat: it may have started anew and forgotten what it was asked for
ORIGIN_NS = 1_000_000_000
WORDS_A_SECOND = 20
ANSWERS = 2
HEARTBEAT = Heartbeat(
    autopilot=MavAutopilot.INVALID, vehicle_type=MavType.GCS, base_mode=0, custom_mode=0, system_status=MavState.ACTIVE
)


@dataclass(slots=True)
class Telemetry:
    """The newest of each thing the drone reported; battery 0..1, NaN where unknown."""

    heartbeat: Heartbeat | None = None
    landed: LandedState = LandedState.UNDEFINED
    battery: float = math.nan
    battery_v: float = math.nan
    setpoint_age_s: float = math.nan
    estimator: EkfStatus | None = None
    origin: bool = False


class DroneLink:
    """The ground's end of one drone's MAVLink. `receive` takes datagrams in, `due` says what to send now."""

    def __init__(
        self,
        body: VehicleBody,
        sysid: int,
        profile: VehicleProfile,
        streams: tuple[tuple[int, float], ...] = (),
        origin: Vec3Tuple | None = None,
    ) -> None:
        """streams: messages to ask for beside its autopilot model's, id and rate, Hz.

        origin: degrees, degrees and metres to tell a drone that waits for them; None where its pose is not ours.
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
        self.codec = Codec(GROUND, reads=READS)
        self.telemetry = Telemetry()
        self.heartbeat_ns = NEVER_NS
        self.model: GroundModel | None = None
        self._flight_mode: FlightMode | None = None
        self.armed_clock = ArmedClock()
        self.commands = CommandChannel()
        self.clock = TimeSyncClient(self.target)
        self.sequence = SequenceMonitor()
        self.parameters = ParameterReader(self.target, MavAutopilot.GENERIC)
        self.foreign_sysid: int | None = None
        self.texts: deque[str] = deque(maxlen=4)
        self.events: list[Event] = []
        self._refusals = Refusals()
        self._second_ns, self._words = NEVER_NS, 0
        self._answers: deque[LinkMessage] = deque(maxlen=ANSWERS)
        self._misaddressed = 0

    @property
    def armed(self) -> bool:
        """Whether its last heartbeat said armed."""
        return self.telemetry.heartbeat is not None and self.telemetry.heartbeat.armed

    def heartbeat_age_s(self, now_ns: int) -> float:
        """Time since its last heartbeat, s; infinite before the first."""
        return math.inf if self.telemetry.heartbeat is None else (now_ns - self.heartbeat_ns) * 1e-9

    @property
    def offboard(self) -> bool:
        """Whether its last heartbeat said that it follows our setpoints."""
        return self._flight_mode is FlightMode.OFFBOARD

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
    def hover_thrust_norm(self) -> float:
        """Thrust that hovers: the autopilot's own parameter where it was measured, else the profile's."""
        if self.model is None:
            return self.profile.hover_thrust_norm
        known = self.parameters.values.get(self.model.table.hover_parameter, self.model.hover_default)
        return known if self.model.hover_measured(known) else self.profile.hover_thrust_norm

    @property
    def idle_disarm_s(self) -> float | None:
        """After how long it disarms by itself when armed without a take-off; the default until that was read."""
        if self.model is None:
            return None
        name, default_s = self.model.table.idle_disarm_parameter, self.model.idle_disarm_default_s
        timeout_s = self.parameters.values.get(name, default_s)
        return timeout_s if timeout_s > 0.0 else None

    def receive(self, data: bytes, now_ns: int) -> None:
        """Take in one datagram; what cannot be read, or is not from this drone's autopilot, is counted."""
        for packet in self.codec.receive(data):
            if packet.source == self._bridge:
                self._read_bridge(packet.message, now_ns)
            if packet.source.component != DRONE_COMPONENT:
                continue
            if packet.source.system != self.sysid:
                self._notice_foreign(packet.source.system, now_ns)
                continue
            skipped = self.codec.misaddressed_packets - self._misaddressed
            self._misaddressed = self.codec.misaddressed_packets
            self.sequence.note(packet.seq, now_ns, skipped)
            self._read(packet.message, now_ns)

    def due(self, now_ns: int) -> list[LinkMessage]:
        """Answers, time sync, commands and parameter requests to send now."""
        messages = list(self._answers)
        self._answers.clear()
        self.events += self._refusals.due(now_ns)
        for one in (self.clock.due(now_ns), self.commands.due(now_ns)):
            if one is not None:
                messages.append(one)
        messages += self.parameters.due(now_ns)
        messages += self._due_origin(now_ns)
        return messages

    def reread_parameters(self) -> None:
        """Ask again for everything that matters before arming."""
        if self.model is not None:
            self.parameters.ask(self.model.parameters)

    def setpoint(self, t_capture_ns: int, q_lab_from_flu: Quat, rate_flu_rad_s: Vec3, thrust_norm: float) -> bytes:
        """SET_ATTITUDE_TARGET stamped with the capture time of the frame it was computed from."""
        ignore = Ignore.BODY_RATES if self.model is None else self.model.setpoint_ignore(self.profile)
        t_ms = t_capture_ns // 1_000_000
        return self.codec.encode(
            AttitudeSetpoint(self.target, t_ms, q_lab_from_flu, rate_flu_rad_s, thrust_norm, ignore)
        )

    def pose(self, t_capture_ns: int, pos_lab_m: Vec3, q_lab_from_flu: Quat) -> bytes:
        """Its own pose as the mocap saw it, in the message its autopilot fuses; empty until the autopilot is known."""
        if self.model is None:
            return b""
        return self.codec.encode(self.model.pose(t_capture_ns // 1000, pos_lab_m, q_lab_from_flu))

    def _due_origin(self, now_ns: int) -> list[LinkMessage]:
        """The origin, every second until the drone has repeated it or is ready without."""
        model = self.model
        if self._origin is None or model is None or not model.table.needs_origin or self.telemetry.origin:
            return []
        if now_ns - self._origin_sent_ns < ORIGIN_NS or not model.unready(self.telemetry.estimator):
            return []
        self._origin_sent_ns = now_ns
        return [SetOrigin(self.sysid, *self._origin)]

    def _read(self, message: LinkMessage, now_ns: int) -> None:
        match message:
            case Heartbeat():
                self._hear(message, now_ns)
            case CommandAck():
                if message.command == MavCommand.COMPONENT_ARM_DISARM and message.result is Result.ACCEPTED:
                    self.armed_clock.accept(now_ns)
                self.commands.receive(message, now_ns)
            case TimeSync():
                answer = self.clock.receive(message, now_ns)
                self._answers.extend(() if answer is None else (answer,))
            case ParamValue():
                self.parameters.receive(message)
            case ExtendedSysState():
                self.telemetry.landed = message.landed
            case Battery():
                self.telemetry.battery = _fraction(message.remaining)
                self.telemetry.battery_v = sum(message.cell_v)
            case SysStatus():
                self.telemetry.battery = _fraction(message.battery_remaining)
                self.telemetry.battery_v = message.battery_v
            case EkfStatus():
                self.telemetry.estimator = message
            case Origin():
                self.telemetry.origin = True
            case NamedValue(name="age_ms"):
                self.telemetry.setpoint_age_s = message.value * 1e-3
            case StatusText():
                self.texts.append(message.text)
                self._tell(message.severity, message.text, now_ns)

    def _read_bridge(self, message: LinkMessage, now_ns: int) -> None:
        """The bridge beside the autopilot: it asks for our clock, and tells what it does and how old setpoints are."""
        match message:
            case TimeSync(tc1_ns=0):
                self._answers.append(TimeSync(now_ns, message.ts1_ns, self._bridge))
            case NamedValue() | StatusText():
                self._read(message, now_ns)

    def _hear(self, heartbeat: Heartbeat, now_ns: int) -> None:
        silent_ns, self.heartbeat_ns = now_ns - self.heartbeat_ns, now_ns
        self.telemetry.heartbeat = heartbeat
        self.armed_clock.hear(heartbeat.armed, now_ns)
        known = GROUND_MODELS.get(heartbeat.autopilot)
        model = known or self.model
        self._flight_mode = None if model is None else model.table.mode_of(heartbeat.custom_mode)
        if known is None or (known is self.model and silent_ns < RESTART_NS):
            return
        if known is not self.model:
            self.model, self.parameters = known, ParameterReader(self.target, known.table.autopilot)
        self.telemetry.origin = False
        self.reread_parameters()
        silenced = dict.fromkeys(known.unread, 0.0) if self._own_link else {}
        for message_id, rate_hz in {**silenced, **dict(known.streams), **dict(self._streams)}.items():
            self.commands.ask(stream(self.target, message_id, rate_hz))
        self._tell(Severity.INFO, f"drone {self.sysid} is here, {known.name}", now_ns)

    def _notice_foreign(self, system: int, now_ns: int) -> None:
        if system != self.foreign_sysid:
            self.foreign_sysid = system
            self._tell(Severity.ERROR, f"drone {system} answers on the link of drone {self.sysid}", now_ns)

    def _tell(self, severity: Severity, text: str, now_ns: int) -> None:
        """An event in this drone's name, as long as it has not too much to say; what is too much is counted."""
        if now_ns - self._second_ns >= 1_000_000_000:
            self._second_ns, self._words = now_ns, 0
        self._words += 1
        if self._words > WORDS_A_SECOND:
            self._refusals.note(self.name, f"texts beyond {WORDS_A_SECOND} a second", now_ns)
        else:
            self.events.append(Event(severity, self.name, text))


def _fraction(remaining: float) -> float:
    return remaining if 0.0 <= remaining <= 1.0 else math.nan
