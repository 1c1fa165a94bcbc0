"""Poses for a lab of simulated autopilots without cameras: their true states, published as a camera system's frames.

    python examples/sitl_poses.py sitl.toml px4_1=udpout:127.0.0.1:18570 px4_2=udpout:127.0.0.1:18571

Each body of the lab file that flies is reached by a link of its own beside the ground's, written as for pymavlink.
PX4's simulators send HIL_STATE_QUATERNION, ArduPilot's SIM_STATE. A drone begins at its `spawn_lab_m`.
"""

import asyncio
import sys
from dataclasses import dataclass, field
from math import exp
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink import mavutil

from formation.config import LabConfig
from formation.maths.arrays import Quat, Vec3
from formation.maths.geodesy import from_globe
from formation.messages import RawFrame
from wire import clock, config_file
from wire.clock_offset import SenderClock
from wire.mavlink.axes import lab, q_lab_from_flu
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

SMOOTHING_S = 1.1
"""In this time a step of the reported velocity, 1 cm/s, moves a pose by a step of the position, 1e-7 degrees."""
POLL_S, ASK_S = 1e-3, 1.0
LATE, LOST = 1.5, 2.5
"""Periods: after LATE a frame is published without the poses that lack; older than LOST, a pose is not seen."""


@dataclass
class TrueState:
    """One simulated autopilot's true pose in `lab`; the first one is where it starts."""

    start_lab_m: Vec3
    t_ns: int | None = None
    q_lab_from_flu: Quat = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    is_new: bool = False
    _pos_lab_m: Vec3 = field(default_factory=lambda: np.zeros(3))
    _vel_lab_m_s: Vec3 = field(default_factory=lambda: np.zeros(3))
    _origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    _clock: SenderClock = field(default_factory=SenderClock)

    def receive(self, message: Any, now_ns: int) -> None:
        """Receive a message of pymavlink; all but the two that tell the true state are left alone."""
        match message.get_type():
            case "HIL_STATE_QUATERNION":
                stamp_us = message.time_usec  # PX4 leaves it at 0
                t_ns = self._clock.made_ns(stamp_us * 1000, now_ns) if stamp_us else now_ns
                q, vel = message.attitude_quaternion, (message.vx * 0.01, message.vy * 0.01, message.vz * 0.01)
                lat, lon, alt = message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3
            case "SIM_STATE":  # has no stamp
                t_ns, vel = now_ns, (message.vn, message.ve, message.vd)
                q = (message.q1, message.q2, message.q3, message.q4)
                lat, lon, alt = message.lat_int * 1e-7, message.lon_int * 1e-7, message.alt
            case _:
                return
        self._move(t_ns, lab(*vel), (lat, lon, alt))
        self.q_lab_from_flu, self.is_new = q_lab_from_flu(*q), True

    def at_lab_m(self, t_ns: int) -> Vec3:
        """Position, extrapolated by the velocity."""
        passed_s = 0.0 if self.t_ns is None else (t_ns - self.t_ns) * 1e-9
        ahead: Vec3 = self._pos_lab_m + passed_s * self._vel_lab_m_s
        return ahead

    def _move(self, t_ns: int, vel_lab_m_s: Vec3, globe: tuple[float, float, float]) -> None:
        """Integrate the velocity, and follow the position, which comes in steps of a centimetre, slowly."""
        if self.t_ns is None:
            self._pos_lab_m, self._origin = self.start_lab_m, globe
        else:
            passed_s = (t_ns - self.t_ns) * 1e-9
            x_m, y_m = from_globe(self._origin, *globe[:2])
            told_lab_m = self.start_lab_m + np.array([x_m, y_m, globe[2] - self._origin[2]])
            ahead_lab_m = self._pos_lab_m + 0.5 * passed_s * (self._vel_lab_m_s + vel_lab_m_s)
            share = 1.0 - exp(-max(passed_s, 0.0) / SMOOTHING_S)
            self._pos_lab_m = ahead_lab_m + share * (told_lab_m - ahead_lab_m)
        self.t_ns, self._vel_lab_m_s = t_ns, vel_lab_m_s


class Frames:
    """All drones' poses at one time, whenever each has a new one or one is late."""

    def __init__(self, config: LabConfig) -> None:
        flown = [vehicle for vehicle in config.vehicles if vehicle.sysid is not None]
        self.states = {vehicle.body: TrueState(np.array(vehicle.spawn_lab_m)) for vehicle in flown}
        self.period_ns = round(1e9 / config.mocap.rate_hz)
        self._seq = self._sent_ns = 0

    def due(self, now_ns: int) -> RawFrame | None:
        """The frame that is due."""
        states = self.states.values()
        seen = [state.t_ns is not None and now_ns - state.t_ns < LOST * self.period_ns for state in states]
        are_whole = all(state.is_new or not is_seen for state, is_seen in zip(states, seen, strict=True))
        if not any(state.is_new for state in states):
            return None
        if not are_whole and now_ns - self._sent_ns < LATE * self.period_ns:
            return None
        t_ns = max(state.t_ns for state in states if state.is_new and state.t_ns is not None)
        self._seq, self._sent_ns = self._seq + 1, now_ns
        pos, q = [state.at_lab_m(t_ns) for state in states], [state.q_lab_from_flu for state in states]
        for state in states:
            state.is_new = False
        return RawFrame(self._seq, t_ns, tuple(self.states), np.array(pos), np.array(q), np.array(seen))


def ask(mav: Any, sysid: int, period_ns: int) -> None:
    """Say that somebody listens, and ask for the true state that often."""
    mav.heartbeat_send(mavutil.mavlink.MAV_TYPE_GCS, mavutil.mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
    for number in (mavutil.mavlink.MAVLINK_MSG_ID_HIL_STATE_QUATERNION, mavutil.mavlink.MAVLINK_MSG_ID_SIM_STATE):
        interval = mavutil.mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        mav.command_long_send(sysid, 1, interval, 0, number, period_ns // 1000, 0, 0, 0, 0, 0)


async def publish(config: LabConfig, links: dict[str, str]) -> None:
    """Publish frames on the lab's bus until interrupted."""
    bus = MocapBus(await ZenohBus.open(config.link.joined, config.name))
    frames, asked_ns, silent = Frames(config), None, set(links)
    sysids = {vehicle.body: vehicle.sysid or 0 for vehicle in config.vehicles}
    ends = {body: mavutil.mavlink_connection(link, source_system=254) for body, link in links.items()}
    while True:
        now_ns = clock.monotonic_ns()
        if asked_ns is None or now_ns - asked_ns >= ASK_S * 1e9:
            asked_ns = now_ns
            for body, end in ends.items():
                ask(end.mav, sysids[body], frames.period_ns)
        for body, end in ends.items():
            while (message := end.recv_match(blocking=False)) is not None:
                if message.get_srcSystem() == sysids[body]:
                    frames.states[body].receive(message, clock.monotonic_ns())
            if body in silent and frames.states[body].t_ns is not None:
                silent.remove(body)
                print(f"{body} says where it is", flush=True)
        if (frame := frames.due(clock.monotonic_ns())) is not None:
            bus.publish_raw(frame)
        await asyncio.sleep(POLL_S)


def main(lab_file: str, *links: str) -> None:
    """Check the arguments and publish."""
    try:
        config = config_file.load(Path(lab_file), LabConfig)
    except config_file.ConfigError as error:
        sys.exit(str(error))
    given = dict(link.split("=", 1) for link in links)
    flown = [vehicle.body for vehicle in config.vehicles if vehicle.sysid is not None]
    if sorted(given) != sorted(flown):
        sys.exit(f"sitl_poses: links are needed of {', '.join(flown)}, each as BODY=udpout:HOST:PORT")
    asyncio.run(publish(config, given))


if __name__ == "__main__":
    main(*sys.argv[1:])
