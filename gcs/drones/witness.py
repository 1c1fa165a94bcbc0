"""What a drone's own estimator says of it: an independent estimate, beside the mocap, before motors are cut by rule."""

import math
from dataclasses import dataclass

from formation.maths.arrays import Quat, Vec3
from formation.model import Vec3Tuple

FRESH_NS = 300_000_000
NOWHERE: Vec3Tuple = (math.nan, math.nan, math.nan)


@dataclass(slots=True)
class Witness:
    """Its newest attitude and position, each of the time t_ns at which the drone made it, our clock.

    What is older than 0.3 s is not said any more, however lately it arrived.
    Its local frame need not be the lab's: where it begins is settled by a mocap pose while both are trusted.
    """

    _attitude: Quat | None = None
    _attitude_ns: int = 0
    _position: Vec3 | None = None
    _position_ns: int = 0
    _origin_lab_m: Vec3Tuple = NOWHERE

    def receive_attitude(self, q_lab_from_flu: Quat, t_ns: int) -> None:
        """ATTITUDE_QUATERNION came."""
        self._attitude, self._attitude_ns = q_lab_from_flu, t_ns

    def receive_position(self, pos_m: Vec3, t_ns: int) -> None:
        """LOCAL_POSITION_NED came; along the lab's axes, from wherever it counts."""
        self._position, self._position_ns = pos_m, t_ns

    def settle(self, pos_lab_m: Vec3, now_ns: int) -> None:
        """It is here, says the mocap, and nothing is in doubt."""
        if self._position is not None and now_ns - self._position_ns <= FRESH_NS:
            x, y, z = (float(here - own) for here, own in zip(pos_lab_m, self._position, strict=True))
            self._origin_lab_m = (x, y, z)

    def tilt_rad(self, now_ns: int) -> float:
        """The angle of its own vertical to the lab's; NaN where it does not say."""
        if self._attitude is None or now_ns - self._attitude_ns > FRESH_NS:
            return math.nan
        _, x, y, _ = self._attitude.tolist()
        return math.acos(min(max(1.0 - 2.0 * (x * x + y * y), -1.0), 1.0))

    def pos_lab_m(self, now_ns: int) -> Vec3Tuple:
        """Where it believes itself; NaN where it does not say, or its origin was never settled."""
        if self._position is None or now_ns - self._position_ns > FRESH_NS:
            return NOWHERE
        (x, y, z), (x0, y0, z0) = self._position.tolist(), self._origin_lab_m
        return x + x0, y + y0, z + z0
