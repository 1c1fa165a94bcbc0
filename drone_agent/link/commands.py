"""COMMAND_LONG and COMMAND_INT, read once into one form, obeyed or refused with the MAV_RESULT of the autopilot."""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

from drone_agent.config import AutopilotConfig
from drone_agent.flight.autopilot import Autopilot
from drone_agent.link.schedule import Schedule
from formation.maths.geodesy import from_globe, to_globe
from formation.messages import Severity
from formation.model import Vec3Tuple
from wire.autopilots.table import FlightMode
from wire.link_messages import (
    ARM_PAST_CHECKS,
    DISARM_IN_FLIGHT,
    CommandInt,
    CommandLong,
    LinkMessage,
    MavCommand,
    MavFrame,
    MessageId,
    MessageInterval,
    Result,
)

_RELATIVE_FRAMES = frozenset(
    {
        MavFrame.GLOBAL_RELATIVE_ALT,
        MavFrame.GLOBAL_RELATIVE_ALT_INT,
        MavFrame.GLOBAL_TERRAIN_ALT,
        MavFrame.GLOBAL_TERRAIN_ALT_INT,
    }
)
_LOCAL_FRAMES = frozenset(MavFrame) - _RELATIVE_FRAMES - {MavFrame.GLOBAL, MavFrame.GLOBAL_INT, MavFrame.MISSION}


@dataclass(frozen=True, slots=True)
class Order:
    """One command: number, the four plain parameters, and the place (degrees, and metres above `relative`'s zero)."""

    command: int
    params: tuple[float, float, float, float]
    lat_deg: float
    lon_deg: float
    height_m: float
    relative: bool


def order_of(message: CommandLong | CommandInt) -> Order:
    """The order in either message."""
    if isinstance(message, CommandLong):
        p = message.params
        return Order(message.command, p[:4], p[4], p[5], p[6], relative=False)
    scale = 1e-4 if message.frame in _LOCAL_FRAMES else 1e-7
    position = (message.x * scale, message.y * scale, message.z)
    return Order(message.command, message.params, *position, relative=message.frame in _RELATIVE_FRAMES)


class Commander:
    """Obeys orders; `wanted` collects the messages that were asked for, `answers` what is ready to send."""

    def __init__(self, config: AutopilotConfig, autopilot: Autopilot, schedule: Schedule) -> None:
        self._config = config
        self._pilot = autopilot
        self._schedule = schedule
        self.wanted: list[int] = []
        self.answers: list[LinkMessage] = []
        self._handlers: dict[int, Callable[[Order, int], Result]] = {
            MavCommand.NAV_RETURN_TO_LAUNCH: lambda _order, now: self._pilot.change_mode(FlightMode.RETURN, now),
            MavCommand.NAV_LAND: lambda _order, now: self._pilot.land(now),
            MavCommand.NAV_TAKEOFF: self._take_off,
            MavCommand.DO_SET_MODE: self._set_mode,
            MavCommand.DO_FLIGHTTERMINATION: self._terminate,
            MavCommand.DO_REPOSITION: self._reposition,
            MavCommand.MISSION_START: lambda _order, _now: Result.DENIED,
            MavCommand.COMPONENT_ARM_DISARM: self._arm,
            MavCommand.GET_HOME_POSITION: lambda _order, _now: self._send(MessageId.HOME_POSITION),
            MavCommand.GET_MESSAGE_INTERVAL: self._report_interval,
            MavCommand.SET_MESSAGE_INTERVAL: self._set_interval,
            MavCommand.REQUEST_MESSAGE: lambda order, _now: self._send(_int(order.params[0])),
            MavCommand.REQUEST_AUTOPILOT_CAPABILITIES: lambda _order, _now: self._send(MessageId.AUTOPILOT_VERSION),
        }

    def obey(self, order: Order, now_ns: int) -> Result:
        """Do it or say why not."""
        handler = self._handlers.get(order.command)
        return Result.UNSUPPORTED if handler is None else handler(order, now_ns)

    def set_mode(self, base_mode: int, main: int, sub: int, now_ns: int) -> Result:
        """A change of mode in the autopilot's own numbers."""
        request = self._pilot.model.mode_request(base_mode, main, sub)
        if request.mode is None:
            return request.result
        return self._pilot.change_mode(request.mode, now_ns)

    def _set_mode(self, order: Order, now_ns: int) -> Result:
        base_mode, main, sub = (_int(p) for p in order.params[:3])
        return self.set_mode(base_mode, main, sub, now_ns)

    def _arm(self, order: Order, now_ns: int) -> Result:
        action, force = order.params[0], _int(order.params[1])
        if _int(action) == 1:
            return self._pilot.arm(now_ns, force=force == ARM_PAST_CHECKS and self._pilot.model.force_arm)
        if _int(action) == 0:
            return self._pilot.disarm(force=force == DISARM_IN_FLIGHT, reason="external command")
        self._pilot.report(Severity.CRITICAL, f"Unsupported ARM_DISARM param: {action:.3f}")
        return Result.UNSUPPORTED

    def _take_off(self, order: Order, now_ns: int) -> Result:
        height_m: float | None = order.height_m
        if self._pilot.model.takeoff_in_own_mode and not order.relative:
            # PX4's seventh parameter is above sea level; nothing, or a height below here, is the default height.
            height_m = order.height_m - to_globe(self._origin, self._pilot.belief.pos_lab_m)[2]
        if height_m is None or not isfinite(height_m) or height_m <= 0.0:
            height_m = None
        return self._pilot.take_off(now_ns, height_m)

    def _reposition(self, order: Order, now_ns: int) -> Result:
        if not _int(order.params[1]) & 1:  # MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
            return Result.UNSUPPORTED
        pilot = self._pilot
        here = pilot.belief.pos_lab_m
        x, y, z = here
        if isfinite(order.lat_deg + order.lon_deg):
            x, y = from_globe(self._origin, order.lat_deg, order.lon_deg)
        if isfinite(order.height_m):
            home_m = pilot.home.pos_lab_m[2] if pilot.home else here[2]
            z = order.height_m + home_m if order.relative else order.height_m - self._origin[2]
        heading = order.params[3]
        return pilot.go_to(now_ns, (x, y, z), -heading if isfinite(heading) else None)

    def _terminate(self, order: Order, _now_ns: int) -> Result:
        return self._pilot.terminate() if order.params[0] > 0.5 else Result.DENIED

    def _set_interval(self, order: Order, now_ns: int) -> Result:
        known = self._schedule.set_interval_us(_int(order.params[0]), order.params[1], now_ns)
        return Result.ACCEPTED if known else self._pilot.model.no_such_rate

    def _report_interval(self, order: Order, _now_ns: int) -> Result:
        number = _int(order.params[0])
        period_ns = self._schedule.period_ns(number)
        interval_us = 0 if period_ns is None else period_ns // 1000 or -1
        self.answers.append(MessageInterval(number & 0xFFFF, interval_us))
        return Result.ACCEPTED

    def _send(self, number: int) -> Result:
        if not self._schedule.sends(number):
            return self._pilot.model.no_such_message
        self.wanted.append(number)
        return Result.ACCEPTED

    @property
    def _origin(self) -> Vec3Tuple:
        return self._pilot.origin or self._config.origin


def _int(value: float) -> int:
    return round(value) if isfinite(value) else -1
