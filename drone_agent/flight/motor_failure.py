"""A dead motor as an autopilot can tell it: thrust that is not felt, or an attitude that stays out of reach. Pure.

The attitude after PX4's FailureDetector (FD_FAIL_R and FD_FAIL_P, 60 degrees for 0.3 s), but of the error, not of the
attitude, so that it is sooner. The thrust after ArduCopter's thrust-loss check: with one motor dead the mixer gives
up its opposite too, and half of the thrust is gone before the attitude is.
"""

from drone_agent.flight.estimator import up_dot
from formation.maths.arrays import Quat

_ERROR_COS = 0.866
"""Of 30 degrees between the two attitudes' ideas of up; a healthy vehicle closes them within 0.15 s."""
_MISSING = 0.35
"""Share of the thrust asked for; an empty battery takes 0.15."""
_FOR_NS = 200_000_000


class MotorFailure:
    """Watches one vehicle in the air; `update` twenty times a second or more."""

    def __init__(self) -> None:
        self._since_ns: int | None = None

    def update(self, now_ns: int, wanted: Quat, attitude: Quat, missing: float) -> bool:
        """Whether the vehicle cannot do what is asked any more. missing: share of the thrust that is not felt."""
        if missing < _MISSING and up_dot(wanted.tolist(), attitude.tolist()) > _ERROR_COS:
            self._since_ns = None
            return False
        if self._since_ns is None:
            self._since_ns = now_ns
        return now_ns - self._since_ns >= _FOR_NS
