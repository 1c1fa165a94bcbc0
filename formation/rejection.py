"""Why the mocap process does not believe a pose it was given: what LabFrame says of each body it rejects."""

from enum import IntEnum


class Rejection(IntEnum):
    """Why one body's pose is not shown; NONE where it is, or where the cameras do not see the body."""

    NONE = 0
    NOT_FINITE = 1
    NO_ROTATION = 2
    TOO_FAR = 3
    FREEZE = 4
    JUMP = 5
    FLIP = 6
    YAW_RATE = 7
    SWAP = 8
    STAMP = 9

    @property
    def text(self) -> str:
        """In words; the empty text for NONE."""
        return _WORDS[self]


def rejection_text(code: int) -> str:
    """In words, of whatever number; one that is none of ours says so."""
    return Rejection(code).text if code in _WORDS else f"reason {code}, of a later version"


_WORDS = {
    Rejection.NONE: "",
    Rejection.NOT_FINITE: "not finite",
    Rejection.NO_ROTATION: "no unit quaternion",
    Rejection.TOO_FAR: "more than 1000 m away (millimetres?)",
    Rejection.FREEZE: "frozen: the same to the last bit",
    Rejection.JUMP: "jumped farther than it can move",
    Rejection.FLIP: "turned over as it cannot",
    Rejection.YAW_RATE: "yawed faster than it can",
    Rejection.SWAP: "exchanged with another body",
    Rejection.STAMP: "stamped with a time it cannot have",
}
