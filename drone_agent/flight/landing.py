"""Land detection from what an autopilot knows: the thrust it asks for and the motion it estimates."""

_STILL_UP_M_S, _STILL_SIDE_M_S = 0.15, 0.5
_LOW_THRUST, _LIFT_THRUST = 0.7, 0.9
_SETTLE_NS = 400_000_000
_CLIMB_M_S, _HEIGHT_M = 0.1, 0.05


class LandDetector:
    """Landed after 0.4 s of low thrust without motion; flying once it rises under thrust."""

    def __init__(self) -> None:
        self.landed = True
        self._quiet_since_ns: int | None = None
        self._ground_m = 0.0

    def update(
        self, now_ns: int, thrust_to_hover: float, height_m: float, climb_m_s: float, side_m_s: float
    ) -> bool:  # fmt: skip
        """Take one look (20 Hz or so); True where the state changed. Speeds and height are estimates."""
        if self.landed:
            if thrust_to_hover < _LOW_THRUST:
                self._ground_m = height_m
            elif thrust_to_hover > _LIFT_THRUST and (climb_m_s > _CLIMB_M_S or height_m > self._ground_m + _HEIGHT_M):
                self.landed = False
                self._quiet_since_ns = None
                return True
            return False
        quiet = thrust_to_hover < _LOW_THRUST and abs(climb_m_s) < _STILL_UP_M_S and side_m_s < _STILL_SIDE_M_S
        if not quiet:
            self._quiet_since_ns = None
            return False
        if self._quiet_since_ns is None:
            self._quiet_since_ns = now_ns
        if now_ns - self._quiet_since_ns >= _SETTLE_NS:
            self.landed = True
            self._ground_m = height_m
            return True
        return False
