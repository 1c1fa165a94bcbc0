"""A Crazyflie as its peers see it: the model of PX4 with the bridge's modes, a room's speeds, its firmware's times."""

from dataclasses import replace
from math import nan
from types import MappingProxyType

import numpy as np

from drone_agent.autopilots.model import Fusion, ModeRequest, Needs, StreamLoss, Task, Timing, mode_rows
from drone_agent.autopilots.parameters import Parameters
from drone_agent.autopilots.px4 import PX4_MODEL, RATES_HZ, TEXTS
from formation.messages import Severity
from wire.autopilots.crazyflie import CRAZYFLIE
from wire.autopilots.table import FlightMode
from wire.link_messages import MessageId, ModeFlag, Odometry, VisionPose

_FLAGS = ModeFlag.CUSTOM_MODE_ENABLED | ModeFlag.STABILIZE_ENABLED


def _timing(p: Parameters) -> Timing:
    return Timing(
        takeoff_height_m=0.5,
        climb_m_s=0.5,
        land_m_s=0.3,
        disarm_landing_s=2.0,
        disarm_flown_s=2.0,
        disarm_idle_s=p["BRIDGE_IDLE_S"] or -1.0,
        ground_loss_s=nan,
        ground_loss=None,
        battery_low=0.15,
        battery_critical=0.07,
        battery_action=FlightMode.LAND,
        return_height_m=0.0,
        return_slope=0.0,
    )


def _mode_request(base_mode: int, main: int, sub: int) -> ModeRequest:
    return ModeRequest(CRAZYFLIE.mode_at(main, sub) if base_mode & ModeFlag.CUSTOM_MODE_ENABLED else None)


_FUSION = Fusion(np.array([0.02, 0.1, 5.0, 2.6]), 1.0, 0.5)
"""Its estimate is believed within 0.1 m of the poses that it is sent, and for half a second without one."""

CRAZYFLIE_MODEL = replace(
    PX4_MODEL,
    name="crazyflie",
    table=CRAZYFLIE,
    version=0,
    modes=mode_rows(
        CRAZYFLIE,
        (
            (FlightMode.HOLD, _FLAGS, Task.HOLD, Needs.POSITION, True),
            (FlightMode.OFFBOARD, _FLAGS, Task.EXTERNAL, Needs.POSITION | Needs.STREAM, True),
            (FlightMode.TAKEOFF, _FLAGS, Task.TAKEOFF, Needs.POSITION, True),
            (FlightMode.LAND, _FLAGS, Task.LAND, Needs.POSITION, False),
            (FlightMode.DESCEND, _FLAGS, Task.DESCEND, Needs.NOTHING, False),
            (FlightMode.TERMINATION, _FLAGS, Task.OFF, Needs.NOTHING, False),
        ),
    ),
    rates_hz=MappingProxyType({n: rate for n, rate in RATES_HZ.items() if n != MessageId.HIL_STATE_QUATERNION}),
    direct_rates_hz=MappingProxyType({}),
    texts=replace(TEXTS, boot=((Severity.INFO, "Bridge to a Crazyflie"),)),
    timing=_timing,
    mode_request=_mode_request,
    # Before its own watchdog, which levels it after 0.5 s without a setpoint.
    stream_loss=lambda _: StreamLoss(0.2, FlightMode.LAND, Task.LAND),
    fuses_pose=lambda _, message: isinstance(message, VisionPose | Odometry),
    fusion=lambda _: _FUSION,
    attitude_failure=lambda _: None,
)
