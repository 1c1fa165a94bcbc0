"""Which telemetry is due when: default rates, and those that SET_MESSAGE_INTERVAL asked for.

Due times lie on a 10 ms raster where the rate allows, so that messages share a wake-up and a datagram; a
rate the raster does not divide is met on average. A late look sends once; who is to catch up looks at each due time.
"""

from collections.abc import Collection, Mapping

RASTER_NS = 10_000_000
_OFF = 2**63


class Schedule:
    """One link's telemetry, by MAVLink message id."""

    def __init__(self, rates_hz: Mapping[int, float], on_request: Collection[int], t0_ns: int) -> None:
        self._defaults = dict(rates_hz)
        self._on_request = frozenset(on_request)
        self._t0_ns = t0_ns
        self._period_ns: dict[int, int] = {}
        self._ideal_ns: dict[int, int] = {}
        self._due_ns: dict[int, int] = {}
        self.next_ns = _OFF
        """When the next message is due; far in the future if none is."""
        for number, rate in rates_hz.items():
            self._set(number, _period(rate), t0_ns)
        self._find_next()

    def sends(self, number: int) -> bool:
        """Whether this drone has the message, at a rate or on request."""
        return number in self._defaults or number in self._on_request

    def period_ns(self, number: int) -> int | None:
        """The interval in force, 0 for off, None for a message never sent by itself."""
        return self._period_ns.get(number)

    def set_interval_us(self, number: int, interval_us: float, now_ns: int) -> bool:
        """SET_MESSAGE_INTERVAL: 0 the default rate, -1 off.

        False for a message this drone does not have, or an interval that MESSAGE_INTERVAL (int32, us) cannot report.
        """
        if number not in self._defaults or not abs(interval_us) < 2**31:  # NaN, too
            return False
        if interval_us == 0.0:
            period = _period(self._defaults[number])
        else:
            period = max(round(interval_us * 1e3), 1_000_000) if interval_us > 0.0 else 0
        self._set(number, period, now_ns)
        self._find_next()
        return True

    def pop_due(self, now_ns: int) -> list[int]:
        """The messages due now, each once, in the order of their ids' registration; moves them on."""
        if now_ns < self.next_ns:
            return []
        due: list[int] = []
        self.next_ns = _OFF
        for number, due_ns in self._due_ns.items():
            if due_ns <= now_ns:
                due.append(number)
                period = self._period_ns[number]
                ideal = self._ideal_ns[number] + period
                if ideal <= now_ns - period:
                    ideal = now_ns + period
                self._ideal_ns[number] = ideal
                due_ns = self._due_ns[number] = self._rastered(ideal, period)
            self.next_ns = min(self.next_ns, due_ns)
        return due

    def _set(self, number: int, period_ns: int, now_ns: int) -> None:
        self._period_ns[number] = period_ns
        self._ideal_ns[number] = now_ns
        self._due_ns[number] = self._rastered(now_ns, period_ns) if period_ns else _OFF

    def _rastered(self, ideal_ns: int, period_ns: int) -> int:
        if period_ns < RASTER_NS:
            return ideal_ns
        return ideal_ns + (self._t0_ns - ideal_ns) % RASTER_NS

    def _find_next(self) -> None:
        self.next_ns = min(self._due_ns.values(), default=_OFF)


def _period(rate_hz: float) -> int:
    return round(1e9 / rate_hz) if rate_hz > 0.0 else 0
