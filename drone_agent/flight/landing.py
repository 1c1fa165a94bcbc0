"""Land detection from what an autopilot knows: the thrust it asks for, the motion it estimates, its accelerometer."""

from formation.vehicle.body import GRAVITY_M_S2

_STILL_UP_M_S, _STILL_SIDE_M_S = 0.15, 0.5
_LOW_THRUST, _LIFT_THRUST = 0.7, 0.9
_SETTLE_NS = 400_000_000
_CLIMB_M_S, _HEIGHT_M = 0.1, 0.05
_CARRIED_M_S2, _LIFT_LEAST_M_S2 = 0.15 * GRAVITY_M_S2, 0.5 * GRAVITY_M_S2
_SCALE_GAIN, _SCALE_LEAST, _SCALE_MOST = 0.05, 0.4, 2.5
"""Of twenty looks a second: known within a second, as by PX4; as far off as a profile may be."""


class ContactDetector:
    """Whether the floor carries the vehicle: it falls less than its thrust would let it. No pose can feign that."""

    def __init__(self, drag_1_s: float = 0.0) -> None:
        """drag_1_s: of the profile along z, deceleration per m/s: air carries what falls as a floor does."""
        self._drag_1_s = drag_1_s
        self.carried = False
        self.thrust_scale = 1.0
        """Measured over modelled thrust, learned in flight."""
        self._t_ns: int | None = None
        self._climbed_m_s = self._lift_m_s2 = 0.0

    def update(self, t_ns: int, climbed_m_s: float, climb_m_s: float, lift_m_s2: float, *, flies: bool = False) -> bool:
        """Receive a sample.

        climbed_m_s: the climb by the inertial sensors alone, of which only differences count; climb_m_s: as estimated;
        lift_m_s2: the modelled thrust's upward part over mass; flies: no floor is near, and the scale is learned.
        """
        if self._t_ns is not None and t_ns > self._t_ns:
            acc_m_s2 = (climbed_m_s - self._climbed_m_s) / ((t_ns - self._t_ns) * 1e-9)
            measured_m_s2 = acc_m_s2 + GRAVITY_M_S2 + self._drag_1_s * climb_m_s
            lift = 0.5 * (lift_m_s2 + self._lift_m_s2)
            self.carried = measured_m_s2 - self.thrust_scale * lift > _CARRIED_M_S2
            if flies and lift > _LIFT_LEAST_M_S2:
                error = min(max(measured_m_s2 / lift, _SCALE_LEAST), _SCALE_MOST) - self.thrust_scale
                self.thrust_scale += _SCALE_GAIN * error
        self._t_ns, self._climbed_m_s, self._lift_m_s2 = t_ns, climbed_m_s, lift_m_s2
        return self.carried


class LandDetector:
    """Landed after 0.4 s of low thrust without motion on a floor that carries; flying once it rises under thrust."""

    def __init__(self) -> None:
        self.landed = True
        self._quiet_since_ns: int | None = None
        self._ground_m = 0.0

    def update(
        self, now_ns: int, thrust_to_hover: float, height_m: float, climb_m_s: float, side_m_s: float,
        *, carried: bool, faded: bool,
    ) -> bool:  # fmt: skip
        """Take one look (20 Hz or so); True where the state changed. Speeds and height are estimates.

        carried: see ContactDetector; faded: a landing has taken the thrust away, so that no estimate is needed.
        """
        if self.landed:
            climbs, is_high = climb_m_s > _CLIMB_M_S, height_m > self._ground_m + _HEIGHT_M
            if thrust_to_hover < 1.0 / _SCALE_MOST:
                self._ground_m = height_m
            elif (climbs and is_high) or (thrust_to_hover > _LIFT_THRUST and (climbs or is_high)):
                self.landed = False
                self._quiet_since_ns = None
                return True
            return False
        still = abs(climb_m_s) < _STILL_UP_M_S and side_m_s < _STILL_SIDE_M_S
        if not (carried and thrust_to_hover < _LOW_THRUST and (still or faded)):
            self._quiet_since_ns = None
            return False
        if self._quiet_since_ns is None:
            self._quiet_since_ns = now_ns
        if now_ns - self._quiet_since_ns >= _SETTLE_NS:
            self.landed = True
            self._ground_m = height_m
            return True
        return False
