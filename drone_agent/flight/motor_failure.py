"""A dead motor as an autopilot can tell it: an attitude that stays far from the one asked for. Pure.

After PX4's FailureDetector (FD_FAIL_R and FD_FAIL_P, 60 degrees for 0.3 s), but of the error, not of the attitude, so
that it is sooner; the attitude loop of a healthy vehicle closes such an error within 0.15 s.
"""

from drone_agent.flight.estimator import up_dot
from formation.maths.arrays import Quat

_ERROR_COS = 0.866
"""Of 30 degrees between the two attitudes' ideas of up."""
_FOR_NS = 200_000_000


class MotorFailure:
    """Watches one vehicle in the air; `update` twenty times a second or more."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def update(self, now_ns: int, wanted: Quat, attitude: Quat) -> bool:
        """Whether the vehicle cannot be turned to `wanted` any more."""
        if up_dot(wanted.tolist(), attitude.tolist()) > _ERROR_COS:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = now_ns
        return now_ns - self._since_ns >= _FOR_NS
