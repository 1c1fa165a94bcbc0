"""The stream of setpoints as an autopilot itself watches it: alive, or timed out."""


class SetpointStream:
    """Of one vehicle. An autopilot asks neither whose setpoints they are nor how old."""

    def __init__(self) -> None:
        self.last_ns: int | None = None
        """When the newest came."""
        self.lost = False
        """Whether it timed out, and none has come since."""
        self._followed = False

    def note(self, now_ns: int, *, in_mode: bool) -> None:
        """A setpoint came; in_mode: the autopilot follows setpoints."""
        self.last_ns = now_ns
        self._followed, self.lost = in_mode, False

    def begin(self, now_ns: int, time_out_s: float) -> None:
        """A mode begins that follows setpoints: a stream that is alive may time out from now on."""
        self._followed, self.lost = not self.is_silent(now_ns, time_out_s), False

    def end(self) -> None:
        """Another mode begins, or the motors are off."""
        self._followed = self.lost = False

    def is_silent(self, now_ns: int, time_out_s: float) -> bool:
        """Whether none has come for so long, or ever."""
        return self.last_ns is None or now_ns >= self.last_ns + round(time_out_s * 1e9)

    def deadline_ns(self, time_out_s: float) -> int | None:
        """When it will have timed out; None while it is not followed."""
        if not self._followed or self.lost or self.last_ns is None:
            return None
        return self.last_ns + round(time_out_s * 1e9)
