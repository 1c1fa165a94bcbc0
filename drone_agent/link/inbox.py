"""The agent's reaction to each MAVLink message that comes in, and its answers."""

from collections.abc import Callable, Mapping
from typing import Any

from drone_agent.config import AutopilotConfig
from drone_agent.flight.autopilot import Autopilot
from drone_agent.flight.failsafes import Failsafes
from drone_agent.flight.guidance import Guidance
from drone_agent.flight.vehicle import ExternalPose
from drone_agent.link.commands import Commander, order_of
from formation.messages import Event, Severity
from wire.clock_offset import ClockOffset
from wire.link_messages import (
    Address,
    AttitudeSetpoint,
    CommandAck,
    CommandInt,
    CommandLong,
    Heartbeat,
    LinkMessage,
    LogEntry,
    LogRequestList,
    MavAutopilot,
    MissionCount,
    MissionRequestList,
    MocapPose,
    Odometry,
    Origin,
    Packet,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    Ping,
    PositionSetpoint,
    SetMode,
    SetOrigin,
    TimeSync,
    VisionPose,
)
from wire.mavlink.messages import TABLE
from wire.rejections import RejectionLog

_POSE_AGE_MAX_NS = 500_000_000
_POSE_DELAY_NS = 20_000_000  # of a pose whose stamp is on no clock we know
_CLOCKS = 8

Send = Callable[[LinkMessage], None]


class Inbox:
    """Reads packets; answers go through `send`, accepted poses through `use_pose`."""

    def __init__(
        self,
        config: AutopilotConfig,
        autopilot: Autopilot,
        failsafes: Failsafes,
        commander: Commander,
        t0_ns: int,
        send: Send,
        use_pose: Callable[[ExternalPose, int], None],
    ) -> None:
        self._config = config
        self._pilot = autopilot
        self._failsafes = failsafes
        self._commander = commander
        self._t0_ns = t0_ns
        self._send = send
        self._use_pose = use_pose
        self._guidance = Guidance(autopilot)
        self.rejections = RejectionLog()
        """Messages of its own that MAVLink cannot encode."""
        self._clocks: dict[Address, ClockOffset] = {}
        self.listing: int | None = None
        """The next parameter of a list that was asked for."""

    def due_events(self, now_ns: int) -> tuple[Event, ...]:
        """The due reports of what was not sent."""
        return self.rejections.due(now_ns) if self.rejections.has_pending else ()

    def read(self, packet: Packet, now_ns: int) -> None:
        """Act on one packet; what concerns only ground stations is left alone."""
        reader = _READERS.get(type(packet.message))
        if reader is not None:
            reader(self, packet.source, packet.message, now_ns)

    def _setpoint(self, _source: Address, message: AttitudeSetpoint, now_ns: int) -> None:
        self._guidance.attitude(now_ns, message)

    def _position(self, _source: Address, message: PositionSetpoint, now_ns: int) -> None:
        self._guidance.position(now_ns, message)

    def _set_origin(self, _source: Address, message: SetOrigin, _now_ns: int) -> None:
        if self._config.pose == "mocap":
            self._pilot.origin = (message.lat_deg, message.lon_deg, message.alt_m)
        if self._pilot.origin is not None:
            self._send(Origin(*self._pilot.origin))

    def _pose(self, source: Address, message: VisionPose | MocapPose | Odometry, now_ns: int) -> None:
        pilot = self._pilot
        if pilot.model.fuses_pose(pilot.parameters, message):
            capture_ns = self._capture_ns(source, message.t_us * 1000, now_ns)
            self._use_pose(ExternalPose(capture_ns, message.pos_lab_m, message.q_lab_from_flu), now_ns)

    def _capture_ns(self, source: Address, stamp_ns: int, now_ns: int) -> int:
        """A pose's capture on our clock: its stamp is our time since boot, or the sender's own clock."""
        own_ns = self._clock(source).to_ours_ns(stamp_ns)
        for since_boot_ns in (stamp_ns,) if own_ns is None else (stamp_ns, own_ns):
            if 0 <= now_ns - self._t0_ns - since_boot_ns <= _POSE_AGE_MAX_NS:
                return self._t0_ns + since_boot_ns
        return now_ns - _POSE_DELAY_NS

    def _timesync(self, source: Address, message: TimeSync, now_ns: int) -> None:
        boot_ns = now_ns - self._t0_ns
        if message.tc1_ns == 0:
            self._send(TimeSync(max(boot_ns, 1), message.ts1_ns, source))  # zero would be a request
        else:
            self._clock(source).exchange(message.ts1_ns, message.tc1_ns, boot_ns)

    def _clock(self, source: Address) -> ClockOffset:
        """The clock of a sender against ours; of more than eight at a time the first is forgotten."""
        known = self._clocks.get(source)
        if known is None:
            if len(self._clocks) >= _CLOCKS:
                del self._clocks[next(iter(self._clocks))]
            known = self._clocks[source] = ClockOffset()
        return known

    def _heartbeat(self, _source: Address, message: Heartbeat, now_ns: int) -> None:
        if message.autopilot is MavAutopilot.INVALID:
            self._failsafes.ground_seen(now_ns)

    def _command(self, source: Address, message: CommandLong | CommandInt, now_ns: int) -> None:
        result = self._commander.obey(order_of(message), now_ns)
        self._send(CommandAck(source, message.command, result))

    def _set_mode(self, source: Address, message: SetMode, now_ns: int) -> None:
        model = self._pilot.model
        main, sub = model.table.split(message.custom_mode)
        result = self._commander.set_mode(message.base_mode, main, sub, now_ns)
        self._send(CommandAck(source, model.set_mode_ack, result))

    def _ping(self, source: Address, message: Ping, _now_ns: int) -> None:
        if message.target.system == 0:
            self._send(Ping(message.t_us, message.seq, source))

    def _param_read(self, _source: Address, message: ParamRequestRead, _now_ns: int) -> None:
        found = self._pilot.parameters.message(message.index if message.index >= 0 else message.name)
        if found is not None:
            self._send(found)
        else:
            self._unknown_parameter(message.name)

    def _param_list(self, _source: Address, _message: ParamRequestList, _now_ns: int) -> None:
        self.listing = 0

    def _param_set(self, _source: Address, message: ParamSet, _now_ns: int) -> None:
        parameters = self._pilot.parameters
        if message.name not in parameters:
            self._unknown_parameter(message.name)
            return
        parameters.set_raw(message.name, message.raw, message.type)
        value = parameters.message(message.name)
        if value is not None:
            self._send(value)

    def _mission_list(self, source: Address, message: MissionRequestList, _now_ns: int) -> None:
        """No missions here: said, so that a ground station need not ask again."""
        self._send(MissionCount(source, 0, message.kind))

    def _log_list(self, _source: Address, _message: LogRequestList, _now_ns: int) -> None:
        """No logs either."""
        self._send(LogEntry(0, 0, 0, 0, 0))

    def _unknown_parameter(self, name: str) -> None:
        self._pilot.report(Severity.INFO, self._pilot.model.texts.unknown_parameter, name)


_READERS: Mapping[type, Callable[[Inbox, Address, Any, int], None]] = {
    AttitudeSetpoint: Inbox._setpoint,
    PositionSetpoint: Inbox._position,
    VisionPose: Inbox._pose,
    MocapPose: Inbox._pose,
    Odometry: Inbox._pose,
    TimeSync: Inbox._timesync,
    Heartbeat: Inbox._heartbeat,
    CommandLong: Inbox._command,
    CommandInt: Inbox._command,
    SetMode: Inbox._set_mode,
    Ping: Inbox._ping,
    ParamRequestRead: Inbox._param_read,
    ParamRequestList: Inbox._param_list,
    ParamSet: Inbox._param_set,
    SetOrigin: Inbox._set_origin,
    MissionRequestList: Inbox._mission_list,
    LogRequestList: Inbox._log_list,
}
READS = frozenset(row.layout.id for row in TABLE if row.kind in _READERS)
"""By their ids; what only ground stations care for is not even decoded."""
