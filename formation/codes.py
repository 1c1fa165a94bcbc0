"""What programs decide on: the phase and the severity of events. Without arrays: operators' commands load them."""

from enum import IntEnum


class Phase(IntEnum):
    """Where the flight is; the whole swarm shares one phase (formation.safety.phases)."""

    GROUND = 0
    ARMED = 1
    TAKEOFF = 2
    FORMATION = 3
    HOLD = 4
    LAND = 5
    STOPPED = 6


class Severity(IntEnum):
    """MAV_SEVERITY's scale, the one every operator knows."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6
    DEBUG = 7
