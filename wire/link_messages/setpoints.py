"""Setpoints for a vehicle, and the targets that it reports back."""

from enum import IntEnum, IntFlag
from typing import NamedTuple

from formation.maths.arrays import Quat, Vec3
from wire.link_messages.address import Address


class Ignore(IntFlag):
    """ATTITUDE_TARGET_TYPEMASK."""

    NONE = 0
    ROLL_RATE = 1
    PITCH_RATE = 2
    YAW_RATE = 4
    BODY_RATES = 7
    THRUST = 64
    ATTITUDE = 128


class AttitudeSetpoint(NamedTuple):
    """SET_ATTITUDE_TARGET (82)."""

    target: Address
    t_boot_ms: int
    q_lab_from_flu: Quat
    rate_flu_rad_s: Vec3
    thrust_norm: float
    ignore: Ignore


class AttitudeTargetReport(NamedTuple):
    """ATTITUDE_TARGET (83): what the autopilot is tracking."""

    t_boot_ms: int
    q_lab_from_flu: Quat
    rate_flu_rad_s: Vec3
    thrust_norm: float
    ignore: Ignore


class LocalFrame(IntEnum):
    """MAV_FRAME of a position setpoint: absolute, from here in lab axes, in body axes, from here in body axes."""

    LOCAL = 1
    LOCAL_OFFSET = 7
    BODY = 8
    BODY_OFFSET = 9


class PositionIgnore(IntFlag):
    """POSITION_TARGET_TYPEMASK."""

    NONE = 0
    POSITION = 7
    VELOCITY = 56
    ACCELERATION = 448
    FORCE = 512
    YAW = 1024
    YAW_RATE = 2048


class PositionSetpoint(NamedTuple):
    """SET_POSITION_TARGET_LOCAL_NED (84): vectors in lab axes, or the body's forward, left, up, by `frame`."""

    target: Address
    t_boot_ms: int
    frame: LocalFrame
    ignore: PositionIgnore
    pos_m: Vec3
    vel_m_s: Vec3
    acc_m_s2: Vec3
    yaw_rad: float
    yaw_rate_rad_s: float
