"""What the ground wants of one drone's autopilot, and the next command towards it: wanted against reported, every tick.

An acknowledgement alone never counts as done; the drone's next heartbeat does.
"""

from enum import StrEnum

from gcs.drones import commands
from gcs.drones.link_state import DroneLink
from wire.link_messages.commands import CommandLong


class Goal(StrEnum):
    """The state the drone's autopilot is to be brought to."""

    LEAVE = "leave as it is"
    FLY = "off-board and armed"
    JOIN = "off-board, following this ground"
    LAND = "landing by itself"
    DISARM = "disarmed"
    CUT = "motors cut"


def is_reached(goal: Goal, link: DroneLink, since_ns: int) -> bool:
    """Whether a heartbeat younger than `since_ns` reports the goal."""
    if goal is Goal.LEAVE:
        return True
    if link.heartbeat_ns <= since_ns:
        return False
    if goal is Goal.FLY:
        return link.armed and link.offboard
    if goal is Goal.JOIN:
        return link.offboard and _control_asked(link)
    return not link.armed


STREAM_FIRST_NS = 1_200_000_000  # PX4 wants a second of setpoints before it changes to off-board
HOLD_OFF_NS = 1_000_000_000  # an answer stands until the next heartbeat could tell more
CUT_HOLD_OFF_NS = 100_000_000


def pursue(goal: Goal, link: DroneLink, since_ns: int, now_ns: int) -> None:
    """Ask for the next command towards the goal; nothing when it is reached, or while one is on its way or settling."""
    if is_reached(goal, link, since_ns):
        link.commands.calm()
        return
    command = _next(goal, link)
    if goal is Goal.JOIN and link.model is not None and command == link.model.set_offboard(link.target):
        command = command if now_ns - since_ns >= STREAM_FIRST_NS else None
    if command is None:
        return
    hold_off_ns = CUT_HOLD_OFF_NS if goal is Goal.CUT else HOLD_OFF_NS
    answer = link.commands.answers.get(command)
    if answer is not None and now_ns - answer.t_ns < hold_off_ns:
        return
    if goal is Goal.CUT:
        link.commands.urge(command)
    else:
        link.commands.ask(command)


def _next(goal: Goal, link: DroneLink) -> CommandLong | None:
    match goal:
        case Goal.CUT:
            return commands.cut(link.target)
        case Goal.DISARM:
            return commands.disarm(link.target)
        case Goal.LAND:
            return None if link.landing else commands.land(link.target)
        case Goal.JOIN if not _control_asked(link):
            return _control(link)
        case Goal.JOIN if link.model is not None and not link.offboard:
            return link.model.set_offboard(link.target)
        case Goal.FLY if link.model is not None:
            return commands.arm(link.target) if link.offboard else link.model.set_offboard(link.target)
        case _:
            return None


def _control(link: DroneLink) -> CommandLong:
    return commands.request_control(link.target, link.codec.own)


def _control_asked(link: DroneLink) -> bool:
    """Whether it was asked to follow this ground; a real autopilot answers that it does not know what that means."""
    return _control(link) in link.commands.answers
