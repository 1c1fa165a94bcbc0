"""One drone as its link shows it: what it last said, its clock, losses, parameters and commands. No policy here."""

import math
from collections import deque

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
from gcs.drones.telemetry import NEVER_NS, PILOTED, READS, READS_IF_ASKED, Telemetry
from gcs.drones.witness import Witness
from wire.autopilots.table import FlightMode
from wire.link_messages.address import (
    BRIDGE_COMPONENT,
    DRONE_COMPONENT,
    GROUND,
    GROUND_COMPONENTS,
    GROUND_SYSTEM,
    Address,
)
from wire.link_messages.clocks import TimeSync
from wire.link_messages.commands import CommandAck, MavCommand, Result
from wire.link_messages.motion import AttitudeQuaternion, InertialSample, LocalPosition, Origin, SetOrigin
from wire.link_messages.packet import LinkMessage
from wire.link_messages.parameters import ParamValue
from wire.link_messages.setpoints import AttitudeSetpoint, Ignore
from wire.link_messages.status import (
    Battery,
    EkfStatus,
    ExtendedSysState,
    Heartbeat,
    MavAutopilot,
    NamedValue,
    StatusText,
    SysStatus,
)
from wire.mavlink.codec import Codec
from wire.refusals import Refusals
from wire.timesync import TimeSyncClient, slip_text

RESTART_NS = 2_500_000_000  # without a heartbeat: it may have started anew and forgotten what it was asked for
ORIGIN_NS = 1_000_000_000
WORDS_A_SECOND = 20
ANSWERS = 2
ATTITUDES = 8
OTHER_GROUND_S = 3.0
AGE_FRESH_NS = 1_000_000_000
BEHIND_FRESH_NS = 100_000_000
FORCE_LOST_NS = 3_000_000_000
SLIP_AGAIN_NS = 60_000_000_000
STAMPED_MS = 10_000.0
"""No link is so far behind: such a stamp is not of the clock that TIMESYNC tells of."""


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
        self.codec = Codec(own, reads=READS | (READS_IF_ASKED & dict(streams).keys()))
        self.telemetry = Telemetry()
        self.witness = Witness()
        self.heartbeat_ns = self.heard_ns = NEVER_NS
        self._other_ground_ns = NEVER_NS
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
        self._attitudes: deque[tuple[int, Quat]] = deque(maxlen=ATTITUDES)
        self._misaddressed = 0
        self._asked_ns, self._forceless = NEVER_NS, False
        self._behind_s, self._behind_ns = math.nan, NEVER_NS
        self._slip_told_ns = NEVER_NS

    @property
    def armed(self) -> bool:
        """Whether its last heartbeat said armed."""
        return self.telemetry.heartbeat is not None and self.telemetry.heartbeat.armed

    def heartbeat_age_s(self, now_ns: int) -> float:
        """Time since its last heartbeat, s; infinite before the first."""
        return math.inf if self.telemetry.heartbeat is None else (now_ns - self.heartbeat_ns) * 1e-9

    def silent_s(self, now_ns: int) -> float:
        """Time since anything valid was heard of it, s; infinite before the first."""
        return math.inf if self.heard_ns == NEVER_NS else (now_ns - self.heard_ns) * 1e-9

    def behind_s(self, now_ns: int) -> float:
        """How old its newest telemetry was when it was read, by the drone's own clock, s: what waited in a queue on the
        way, or here. NaN where its clock is not known, or nothing stamped came just now: one late message before a
        pause, as of a machine that stalled, is no backlog, of which all that comes is late."""
        return self._behind_s if now_ns - self._behind_ns <= BEHIND_FRESH_NS else math.nan

    def setpoint_age_s(self, now_ns: int) -> float:
        """How old setpoints are when they reach it, camera to drone, s; NaN where it has not said of late."""
        told = self.telemetry
        return told.setpoint_age_s if now_ns - told.setpoint_age_ns <= AGE_FRESH_NS else math.nan

    def answers_other_ground(self, now_ns: int) -> bool:
        """Whether it was lately heard to answer another ground than this."""
        return now_ns - self._other_ground_ns < round(OTHER_GROUND_S * 1e9)

    @property
    def piloted(self) -> bool:
        """Whether its last heartbeat said that a person flies it: armed, in a mode that is a pilot's."""
        heartbeat, model = self.telemetry.heartbeat, self.model
        if heartbeat is None or model is None or not heartbeat.armed or self._flight_mode not in PILOTED:
            return False
        return model.table.split(heartbeat.custom_mode)[0] != model.table.auto_main  # PX4 holds by itself

    @property
    def landing(self) -> bool:
        """Whether its last heartbeat said that it lands by itself."""
        return self._flight_mode in (FlightMode.LAND, FlightMode.DESCEND)

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
        if self.model is not None:
            known = self.parameters.values.get(self.model.table.hover_parameter)
            if known is not None and self.model.hover_measured(known):
                return known
        return self.profile.hover_thrust_norm

    @property
    def idle_disarm_s(self) -> float | None:
        """After how long it disarms by itself when armed without a take-off; the default until that was read."""
        if self.model is None:
            return None
        name, default_s = self.model.table.idle_disarm_parameter, self.model.idle_disarm_default_s
        timeout_s = self.parameters.values.get(name, default_s)
        return timeout_s if timeout_s > 0.0 else None

    def receive(self, data: bytes, now_ns: int, superseded: int = 0) -> None:
        """Take in one datagram; what cannot be read, or is not from this drone's autopilot, is counted.

        superseded: packets before it that its link dropped unread.
        """
        for packet in self.codec.receive(data):
            if packet.source == self._bridge:
                self._read_bridge(packet.message, now_ns)
            if packet.source.component != DRONE_COMPONENT:
                continue
            if packet.source.system != self.sysid:
                self._notice_foreign(packet.source.system, now_ns)
                continue
            skipped, superseded = self.codec.misaddressed_packets - self._misaddressed + superseded, 0
            self._misaddressed = self.codec.misaddressed_packets
            self.heard_ns = now_ns
            self.sequence.note(packet.seq, now_ns, skipped)
            self._read(packet.message, now_ns)
        self._overhear(self.codec.overheard, now_ns)
        self.codec.overheard = None

    def take_attitudes(self) -> tuple[tuple[int, Quat], ...]:
        """What it has said of its own attitude since the last call: times, ns, on our clock, and q_lab_from_flu."""
        taken = tuple(self._attitudes)
        self._attitudes.clear()
        return taken

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
                self._notice_force(now_ns)
            case CommandAck():
                if message.command == MavCommand.COMPONENT_ARM_DISARM and message.result is Result.ACCEPTED:
                    self.armed_clock.accept(now_ns)
                self.commands.receive(message, now_ns)
            case TimeSync():
                if message.tc1_ns:
                    self._overhear(message.target, now_ns)
                answer = self.clock.receive(message, now_ns)
                self._report_slip(now_ns)
                self._answers.extend(() if answer is None else (answer,))
            case ParamValue():
                refusal = self.parameters.receive(message, self.armed)
                if refusal:
                    self._refusals.note(self.name, refusal, now_ns)
            case AttitudeQuaternion():
                self.witness.receive_attitude(message.q_lab_from_flu, self._made_ns(message.t_boot_ms, now_ns))
                t_ns = self.clock.clock.to_ours_ns(message.t_boot_ms * 1_000_000)
                if t_ns is not None:
                    self._attitudes.append((t_ns, message.q_lab_from_flu))
            case InertialSample():
                t_ns = self.clock.clock.to_ours_ns(message.t_boot_us * 1000)
                if t_ns is not None and not self.telemetry.force.hear(t_ns, message.specific_force_flu_m_s2, now_ns):
                    self._refusals.note(self.name, "specific force beyond 16 g", now_ns)
            case LocalPosition():
                self.witness.receive_position(message.pos_lab_m, self._made_ns(message.t_boot_ms, now_ns))
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
                self.telemetry.setpoint_age_s, self.telemetry.setpoint_age_ns = message.value * 1e-3, now_ns
            case StatusText():
                self.texts.append(message.text)
                self._tell(message.severity, message.text, now_ns)

    def _report_slip(self, now_ns: int) -> None:
        """Name a clock that runs at another rate, once a minute."""
        slip = self.clock.slip
        if slip is not None and now_ns - self._slip_told_ns >= SLIP_AGAIN_NS:
            self._slip_told_ns = now_ns
            self._tell(Severity.WARNING, slip_text(slip), now_ns)

    def _made_ns(self, t_boot_ms: int, now_ns: int) -> int:
        """When the drone made what it stamped so, our clock; NEVER_NS where its clock does not tell."""
        age_ms = self.clock.clock.since_ms(t_boot_ms, now_ns)
        if age_ms is None or abs(age_ms) > STAMPED_MS:
            return NEVER_NS
        self._behind_s, self._behind_ns = max(age_ms, 0.0) * 1e-3, now_ns
        return now_ns - round(age_ms * 1e6)

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
        self._asked_ns = now_ns
        silenced = dict.fromkeys(known.unread, 0.0) if self._own_link else {}
        for message_id, rate_hz in {**silenced, **dict(known.streams), **dict(self._streams)}.items():
            self.commands.ask(stream(self.target, message_id, rate_hz))
        self._tell(Severity.INFO, f"drone {self.sysid} is here, {known.name}", now_ns)

    def _notice_force(self, now_ns: int) -> None:
        """Tell where an accelerometer that was asked for is not told of, and when it is again."""
        if self.model is None or not READS_IF_ASKED & dict(self._streams).keys():
            return
        silent = now_ns - max(self._asked_ns, self.telemetry.force.heard_ns) > FORCE_LOST_NS
        if silent and not self._forceless:
            self._tell(Severity.WARNING, "sends no HIGHRES_IMU that was asked for: flown without", now_ns)
        elif self._forceless and not silent:
            self._tell(Severity.INFO, "sends HIGHRES_IMU", now_ns)
        self._forceless = silent

    def _overhear(self, other: Address | None, now_ns: int) -> None:
        """Notice that it answers another ground: to whom one of its answers was addressed."""
        if other is None or other == self.codec.own or other.system != GROUND_SYSTEM:
            return
        if other.component in GROUND_COMPONENTS:
            self._other_ground_ns = now_ns

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
