"""What passes between an operator and the ground. Without arrays: who asks for a stop waits for no numpy."""

from dataclasses import dataclass
from enum import StrEnum

LAB = "lab"
ENDPOINT = "tcp/127.0.0.1:7447"
"""Where a lab's ground is asked, where nothing else is said."""


CONFIGURED = "configured"
"""The shape that the followers' own entries make; the leader's trajectory that its own entry says."""


class Verb(StrEnum):
    """What an operator can ask of the ground."""

    STATUS = "status"
    ARM = "arm"
    ADOPT = "adopt"
    TAKEOFF = "takeoff"
    START = "start"
    HOLD = "hold"
    LAND = "land"
    STOP = "stop"
    SHAPE = "shape"
    TRAJECTORY = "trajectory"
    RESET = "reset"


@dataclass(frozen=True, slots=True)
class OperatorRequest:
    """One request; `argument` is the verb's own text (the shape's name, say)."""

    id: int
    verb: Verb
    argument: str = ""


@dataclass(frozen=True, slots=True)
class OperatorReply:
    """The answer to request `id`: accepted or not, with the reason in words."""

    id: int
    accepted: bool
    text: str
