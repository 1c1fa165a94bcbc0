"""One Crazyflie: CRTP packets and time in; packets, samples and its own estimate out. No socket, no clock.

Its firmware keeps attitude, estimates where it is by the poses that it is sent, and has the last word: its supervisor
arms, its watchdog levels it 0.5 s after the last setpoint and stops its motors after 2 s. Neither is fed without cause.
"""

import math
from collections.abc import Generator

import numpy as np

from drone_agent.autopilots.model import Fusion
from drone_agent.autopilots.parameters import Parameters
from drone_agent.flight.autopilot import Note
from drone_agent.flight.vehicle import ExternalPose, ImuSample
from drone_agent.guard.position import Belief, LoopSetpoint
from drone_agent.simulation.battery import SAG_V, remaining_at
from formation.maths.arrays import Quat, Vec3
from formation.maths.frames import IDENTITY, rotate_one, wrap_angle
from formation.maths.quaternion import heading_of, thrust_axis
from formation.messages import Severity
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from wire import crtp
from wire.autopilots.crazyflie import FIRMWARE_PARAMETERS
from wire.crtp import Connection, Port, Request, Supervisor

LEVELS_NS, STOPS_NS = 500_000_000, 2_000_000_000
"""Its watchdog's times: COMMANDER_WDT_TIMEOUT_STABILIZE and _SHUTDOWN."""
_ASK_AGAIN_NS, _ORDER_AGAIN_NS = 200_000_000, 20_000_000
"""As cflib asks again; an order that it has not confirmed is repeated faster than poses come."""
_LAGS_NS, _LATE_MOST_NS = 1_000_000, 20_000_000
"""In the 10 ms between packets its clock may fall back so far: firmware in the loop loses ticks, 4 % of a second, in
bursts; the age of a sample."""
_READY_NS = 1_000_000_000
_ACC_MOST_G = 32.0
"""Twice what its accelerometer can measure."""
_LOW_POWER = 3
"""Of pm.state: under 3.2 V for 5 s (pm_stm32f4.c)."""
_REJECT_REASONS = (
    (Supervisor.IS_LOCKED, "locked by an emergency stop: switch it off and on"),
    (Supervisor.IS_CRASHED, "its supervisor says that it has crashed: switch it off and on"),
    (Supervisor.IS_TUMBLED, "its supervisor says that it is tumbled: set it upright"),
)
# Setpoints are angles, with an absolute yaw, and thrust is thrust.
_SET = {
    "flightmode.stabModeRoll": 1.0,
    "flightmode.stabModePitch": 1.0,
    "flightmode.stabModeYaw": 1.0,
    "flightmode.althold": 0.0,
    "flightmode.poshold": 0.0,
    "flightmode.posSet": 0.0,
}


class MeasuredPack:
    """Its battery, by its own voltmeter; NaN for what it does not measure."""

    cells = 1
    current_a = used_mah = math.nan

    def __init__(self) -> None:
        self.voltage_v = math.nan
        self.under_load = self.low_power = False

    @property
    def cell_v(self) -> float:
        """Of its one cell."""
        return self.voltage_v

    @property
    def remaining(self) -> float:
        """By the voltage at rest, as a LiPo's curve has it."""
        return 0.0 if self.low_power else remaining_at(self.voltage_v + (SAG_V if self.under_load else 0.0))


class Crazyflie:
    """Is a drone_agent.flight.vehicle.Vehicle and its Estimate; call `tick` no later than `due_ns`."""

    def __init__(self, configured: VehicleProfile, parameters: Parameters, t0_ns: int) -> None:
        self.outbox: list[bytes] = []
        """Packets to send, in order."""
        self.notes: list[Note] = []
        """For the operator."""
        self.lost = 0
        """Log packets that were not read, or are no state."""
        self.sent_again = math.nan
        """Share of packets that its radio had to send again; NaN where nobody measures it."""
        self.due_ns = t0_ns
        self.pack = MeasuredPack()
        self.setpoint = LoopSetpoint(IDENTITY, np.zeros(3), 0.0)
        self.newest_sample: ImuSample | None = None
        self.t_ns = t0_ns
        self.q_lab_from_flu: Quat = IDENTITY.copy()
        self.pos_lab_m: Vec3 = np.zeros(3)
        self.vel_lab_m_s: Vec3 = np.zeros(3)
        self.rate_flu_rad_s: Vec3 = np.zeros(3)
        self.climbed_m_s = 0.0
        self.info: Supervisor | None = None
        """As its supervisor was last heard; None: not since it was connected."""
        self._configured, self._parameters = configured, parameters
        self._armed, self._armed_ns = False, t0_ns
        self._stopping = False
        self._now_ns = self._ordered_ns = self._received_ns = t0_ns
        self._silent = False
        self._state_ns: int | None = None
        self._offset_ns: int | None = None
        self._stamp_ms = self._came = self._sent = 0
        self._missing = 0.0
        self._agreed_ns: int | None = None
        self._since_ns, self._was_ready = 0, False
        self._valid_ns = 0
        self._reject_reason = "no external pose"
        self._yaw_is_absolute = False
        self.connection: Connection | None = None
        self._written: dict[str, float] = {}
        """Parameters as the vehicle has them, by MAVLink name."""
        self._talk: Generator[Request, bytes, None] = self._connect()
        self._request: Request | None = next(self._talk)
        self._asked_ns = t0_ns - _ASK_AGAIN_NS

    # As a vehicle

    @property
    def armed(self) -> bool:
        """Whether its motors may turn."""
        return self._armed

    @armed.setter
    def armed(self, armed: bool) -> None:
        self._armed, self._armed_ns = armed, self._now_ns
        self._order_at_once()
        if not armed:
            self.outbox.append(crtp.encode_motors_off())

    def order(self, _now_ns: int, setpoint: LoopSetpoint) -> None:
        """Send it a setpoint."""
        self.order_now(setpoint)

    def order_now(self, setpoint: LoopSetpoint) -> None:
        """Send it a setpoint, its tilt in the heading that it has now."""
        self.setpoint = setpoint
        if not self._armed:
            return
        thrust = setpoint.thrust_norm
        self.pack.under_load = thrust > 0.0
        heading_rad = heading_of(self.q_lab_from_flu)
        x, y, z = thrust_axis(setpoint.q_lab_from_flu)
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        roll, pitch = -math.asin(min(max(c * y - s * x, -1.0), 1.0)), math.atan2(c * x + s * y, z)
        yaw = heading_of(setpoint.q_lab_from_flu)
        if not self._yaw_is_absolute:
            most = self._configured.rate_yaw_max_rad_s
            turn = self._configured.yaw_p_1_s * float(wrap_angle(np.array(yaw - heading_rad)))
            yaw = -min(max(turn, -most), most)
        raw = min(round(thrust * 65535.0), crtp.THRUST_MOST)
        self.outbox.append(crtp.encode_setpoint(math.degrees(roll), math.degrees(pitch), math.degrees(yaw), raw))

    def stop(self) -> None:
        """Emergency stop, until it says that it is locked; one that is not allowed to fly has its motors off."""
        self._stopping = self.info is None or bool(self.info & Supervisor.CAN_FLY)
        self._order_at_once()

    def advance_to(self, now_ns: int) -> None:
        """It goes on by itself."""

    def drain(self, dt_s: float) -> None:
        """Likewise."""

    @property
    def link_loss(self) -> float:
        """Share of packets that were lost, by the log of the last second, or had to be sent again: the larger one."""
        return max(1.0 if self._silent else self._missing, self.sent_again)

    # As its estimate

    def belief(self) -> Belief:
        """Position, velocity and heading as it last said."""
        x, y, z = self.pos_lab_m.tolist()
        vx, vy, vz = self.vel_lab_m_s.tolist()
        return Belief((x, y, z), (vx, vy, vz), heading_of(self.q_lab_from_flu))

    def rest(self) -> None:
        """Its own estimator's to know."""

    def valid(self, now_ns: int) -> bool:
        """Whether it is heard, and its estimate agreed with a pose lately."""
        agreed_ns = self._agreed_ns
        return self._was_ready and agreed_ns is not None and now_ns - agreed_ns < self._valid_ns and not self._silent

    def fault(self, now_ns: int) -> str | None:
        """Why one must not arm: by itself, or by its estimate."""
        if self.connection is None or self._silent:
            return "the Crazyflie does not answer"
        if self.info is None:
            return "its supervisor is not heard: update its firmware"
        for bit, reason in _REJECT_REASONS:
            if self.info & bit:
                return reason
        if self._agreed_ns is None or now_ns - self._agreed_ns >= self._valid_ns:
            return self._reject_reason
        return None if self._agreed_ns - self._since_ns >= _READY_NS else "external pose not steady yet"

    def receive_pose(self, pose: ExternalPose, now_ns: int, fusion: Fusion) -> None:
        """Send it a pose, and hold its estimate against it."""
        if not np.isfinite(pose.pos_lab_m).all() or not np.isfinite(pose.q_lab_from_flu).all():
            return
        self.outbox.append(crtp.encode_pose(pose.pos_lab_m, pose.q_lab_from_flu))
        sigma_m, sigma_rad, limit, heading_limit = fusion.noise_and_limits.tolist()
        self._valid_ns = round(fusion.valid_s * 1e9)
        off_m = float(np.abs(pose.pos_lab_m - self.pos_lab_m).max())
        turned_rad = heading_of(pose.q_lab_from_flu) - heading_of(self.q_lab_from_flu)
        off_rad = abs(math.atan2(math.sin(turned_rad), math.cos(turned_rad)))
        if self._state_ns is None or now_ns - self._state_ns > LEVELS_NS:
            self._reject_reason = "its estimate is not heard"
        elif off_m > sigma_m * limit or off_rad > sigma_rad * heading_limit:
            self._reject_reason = "its estimate is not where the mocap sees it"
        else:
            if self._agreed_ns is None or now_ns - self._agreed_ns >= self._valid_ns:
                self._since_ns = now_ns
            self._agreed_ns, self._reject_reason = now_ns, "external pose is stale"
            self._was_ready = self._was_ready or now_ns - self._since_ns >= _READY_NS

    # Its packets

    def receive(self, data: bytes, now_ns: int) -> None:
        """Receive a packet; any bytes do."""
        if not data:
            return
        self._now_ns = self._received_ns = now_ns
        if self._silent and self.connection is not None:
            self._silent = False
            self._note(Severity.INFO, "the Crazyflie is heard again")
        port, channel = crtp.port_and_channel(data)
        if self._request is not None and self._request.is_answered_by(data):
            self._advance(data, now_ns)
        elif (port, channel) == (Port.LOG, 2) and self.connection is not None and len(data) > 1:
            block = self.connection.blocks.get(data[1])
            read = None if block is None else block.read(data)
            if read is None or not self._receive_log(*read, now_ns):
                self.lost += 1

    def tick(self, now_ns: int) -> None:
        """Ask again, order again, notice a silence."""
        self._now_ns = now_ns
        if not self._silent and self.connection is not None and now_ns - self._received_ns >= LEVELS_NS:
            self._silent = True
            self._note(Severity.CRITICAL, "the Crazyflie is silent: its watchdog levels it, then stops its motors")
        if self._silent and self.connection is not None and now_ns - self._received_ns >= STOPS_NS:
            self.connection, self.info, self._state_ns = None, None, None  # it may have been switched off and on
            self._begin(self._connect())
        if self._request is None:
            self._write_changed()
        if self._request is not None and now_ns - self._asked_ns >= _ASK_AGAIN_NS:
            self._asked_ns = now_ns
            self.outbox.append(self._request.packet)
        if self.connection is not None and now_ns - self._ordered_ns >= _ORDER_AGAIN_NS:
            self._ordered_ns = now_ns
            self._order_again(self.connection.version)
        self.due_ns = now_ns + _ORDER_AGAIN_NS

    def reject_reason(self, now_ns: int) -> str | None:
        """Why, while armed, its own supervisor has its motors off."""
        if self.info is None:
            return None
        for bit, reason in _REJECT_REASONS:
            if self.info & bit:
                return reason
        waited = now_ns - self._armed_ns >= _READY_NS
        return "its supervisor does not arm it" if waited and not self.info & Supervisor.IS_ARMED else None

    def _order_at_once(self) -> None:
        self._ordered_ns = self._now_ns - _ORDER_AGAIN_NS
        self.due_ns = self._now_ns

    def _order_again(self, version: int) -> None:
        """What its supervisor has not confirmed; a setpoint of no thrust unlocks the thrust of those that follow."""
        info = self.info or Supervisor(0)
        if self._stopping:
            self._stopping = not info & Supervisor.IS_LOCKED
            self.outbox.append(crtp.encode_emergency_stop(version))
        elif self._armed and not info & Supervisor.IS_ARMED:
            self.outbox += [crtp.encode_setpoint(0.0, 0.0, 0.0, 0), crtp.encode_arming(version, True)]
        elif not self._armed and info & Supervisor.IS_ARMED and not info & Supervisor.AUTO_ARMED:
            self.outbox += [crtp.encode_motors_off(), crtp.encode_arming(version, False)]

    def _receive_log(self, stamp_ms: int, values: dict[str, float], now_ns: int) -> bool:
        """False for what is no state."""
        if "stateEstimateZ.x" in values:
            x, y, z, vx, vy, vz, roll, pitch, yaw = (values.get(name, 0.0) * 1e-3 for name in crtp.BLOCKS[0][1])
            self.pos_lab_m, self.vel_lab_m_s = np.array([x, y, z]), np.array([vx, vy, vz])
            self.rate_flu_rad_s = np.array([roll, -pitch, yaw])  # its pitch is nose up
            self._state_ns = now_ns
        if "stateEstimate.qw" in values:
            q = np.array([values.get(f"stateEstimate.q{axis}", math.nan) for axis in "wxyz"])
            norm = float(np.linalg.norm(q))
            if not abs(norm - 1.0) < 0.01:
                return False
            self.q_lab_from_flu = q / (norm if q[0] >= 0.0 else -norm)
        if "acc.z" in values:
            acc_g = np.array([values.get(f"acc.{axis}", 0.0) for axis in "xyz"])
            if np.abs(acc_g).max() > _ACC_MOST_G:
                return False
            self._receive_sample(stamp_ms, acc_g * GRAVITY_M_S2, now_ns)
        if "supervisor.info" in values:
            self.info = Supervisor(int(values["supervisor.info"]))
        self.pack.voltage_v = values.get("pm.vbat", self.pack.voltage_v)
        self.pack.low_power = values.get("pm.state", _LOW_POWER if self.pack.low_power else 0) == _LOW_POWER
        return True

    def _receive_sample(self, stamp_ms: int, force_flu_m_s2: Vec3, now_ns: int) -> None:
        """At the time of its own clock, which the packets that were under way for the shortest time set."""
        self._came, self._sent = self._came + 1, self._sent + max((stamp_ms - self._stamp_ms) // 10, 1)
        self._stamp_ms = stamp_ms
        if self._sent >= 100:
            self._missing, self._came, self._sent = 1.0 - self._came / self._sent, 0, 0
        late_ns = now_ns - stamp_ms * 1_000_000
        known_ns = late_ns if self._offset_ns is None else self._offset_ns
        self._offset_ns = max(min(known_ns + _LAGS_NS, late_ns), late_ns - _LATE_MOST_NS)
        t_ns = max(now_ns - late_ns + self._offset_ns, self.t_ns)
        up = rotate_one(tuple(self.q_lab_from_flu.tolist()), tuple(force_flu_m_s2.tolist()))[2]
        self.climbed_m_s += (up - GRAVITY_M_S2) * (t_ns - self.t_ns) * 1e-9
        self.t_ns = t_ns
        self.newest_sample = ImuSample(t_ns, np.concatenate([force_flu_m_s2, self.rate_flu_rad_s]))

    # The dialogue

    def _begin(self, talk: Generator[Request, bytes, None]) -> None:
        self._talk, self._request = talk, None
        self._advance(b"", self._now_ns)

    def _advance(self, answer: bytes, now_ns: int) -> None:
        try:
            self._request = next(self._talk) if self._request is None else self._talk.send(answer)
        except StopIteration:
            self._request = None
            return
        self._asked_ns = now_ns
        self.outbox.append(self._request.packet)

    def _connect(self) -> Generator[Request, bytes, None]:
        connection = yield from crtp.connect()
        for name, value in _SET.items():
            yield from self._write(connection, name, value)
        self._yaw_is_absolute = "flightmode.stabModeYaw" in connection.parameters
        for name, of_firmware in FIRMWARE_PARAMETERS.items():
            if item := connection.parameters.get(of_firmware):
                found = crtp.parameter_value(item, (yield crtp.read_parameter(item)))
                if found is not None:
                    self._written[name] = found
                    self._parameters.set(name, found)
        self.connection, self._silent = connection, False
        lacks = f"; it has no {', '.join(connection.missing)}" if connection.missing else ""
        self._note(Severity.INFO, f"Crazyflie connected, protocol {connection.version}{lacks}")
        if not self._yaw_is_absolute:
            self._note(Severity.NOTICE, "its firmware has no absolute yaw: the bridge turns it by rate")

    def _write(self, connection: Connection, name: str, value: float) -> Generator[Request, bytes, None]:
        item = connection.parameters.get(name)
        request = None if item is None else crtp.write_parameter(item, value)
        if request is not None:
            yield request

    def _write_changed(self) -> None:
        """Write on to it what somebody set by MAVLink."""
        for name, value in self._written.items():
            if self.connection is not None and (wanted := self._parameters[name]) != value:
                self._written[name] = wanted
                self._begin(self._write(self.connection, FIRMWARE_PARAMETERS[name], wanted))
                return

    def _note(self, severity: Severity, text: str) -> None:
        self.notes.append(Note(severity, text))
