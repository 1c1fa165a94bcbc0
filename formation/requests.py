"""What passes between an operator and the ground. Without arrays: who asks for a stop waits for no numpy."""

from dataclasses import dataclass
from enum import StrEnum

LAB = "lab"
ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a lab's ground is asked, where nothing else is said."""
SYSID_MOST = 250
"""The largest MAVLink system id of a drone."""
GCS_NAME = "main"
"""The ground of a lab that has one: its name on the bus."""


CONFIGURED = "configured"
"""The shape that the followers' own entries make; the leader's trajectory that its own entry says."""


class Verb(StrEnum):
    """What an operator can ask of the ground."""

    STATUS = "status"
    ARM = "arm"
    TAKE_CONTROL = "take_control"
    TAKEOFF = "takeoff"
    START = "start"
    RESUME = "resume"
    HOME = "home"
    HOLD = "hold"
    LAND = "land"
    STOP = "stop"
    EXCLUDE = "exclude"
    INCLUDE = "include"
    REPLACE = "replace"
    SHAPE = "shape"
    TRAJECTORY = "trajectory"
    MOVE = "move"
    RESET = "reset"
    ACKNOWLEDGE = "acknowledge"

    @property
    def command_name(self) -> str:
        """The name of its command line: `gcs take-control`."""
        return self.value.replace("_", "-")


ANSWER_S, SPARE_S, ARMING_S = 3.0, 6.0, 20.0


def time_ns(argument: str) -> int | None:
    """The nanoseconds that an argument of `start` says; None for what is no such number."""
    return int(argument) if argument.isascii() and argument.isdigit() and len(argument) < 20 else None


def answer_s(verb: Verb) -> float:
    """How long the ground's answer is awaited where no other time is given, s: autopilots take their time to arm, and
    a spare beats once a second."""
    return {Verb.ARM: ARMING_S, Verb.REPLACE: SPARE_S}.get(verb, ANSWER_S)


@dataclass(frozen=True, slots=True)
class OperatorRequest:
    """One request; `argument` is the verb's own text (the shape's name, say).

    source: who asks and from where: the name in the certificate where there are keys, user and machine as they say.
    """

    id: int
    verb: Verb
    argument: str = ""
    source: str = ""


@dataclass(frozen=True, slots=True)
class OperatorReply:
    """The answer to request `id`: accepted or not, with reasons in words; codes: their names (formation.reasons)."""

    id: int
    accepted: bool
    text: str
    codes: tuple[str, ...] = ()
