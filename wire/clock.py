"""The machine's clock: the only module that reads it."""

import time
import uuid
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from formation.clock_pair import ClockPair

if TYPE_CHECKING:
    import asyncio

_BOOT = Path("/proc/sys/kernel/random/boot_id")


@dataclass(frozen=True, slots=True)
class Clock:
    """The monotonic clock that all control runs on, one for every process of a machine; flights may slow it down.

    speed: seconds on this clock in one second of the machine's. Processes that are given the same speed share a clock:
    it counts from where the machine's own does.
    """

    speed: float = 1.0

    def monotonic_ns(self) -> int:
        """Nanoseconds now."""
        now_ns = time.monotonic_ns()
        return now_ns if self.speed == 1.0 else int(now_ns * self.speed)

    def pair(self) -> ClockPair:
        """Now, and which date that is, as far apart as two calls take."""
        return ClockPair(self.monotonic_ns(), time.time_ns())

    def at_unix_ns(self, unix_ns: int) -> int:
        """This clock at a date, as far as the machine's date was not set since."""
        pair = self.pair()
        return pair.monotonic_ns + round((unix_ns - pair.unix_ns) * self.speed)

    def name(self) -> bytes:
        """Which clock this is: processes with the same name share it, another name is another machine's clock."""
        try:
            machine = _BOOT.read_bytes().strip()
        except OSError:  # no Linux: the machine's own number, though its clock starts anew with each boot
            machine = f"{uuid.getnode():x}".encode()
        return machine + f" {self.speed:g}".encode()

    def seconds_until(self, deadline_ns: int) -> float:
        """How long the machine takes until then, by its own clock; 0 where that has passed."""
        return max((deadline_ns - self.monotonic_ns()) * 1e-9 / self.speed, 0.0)

    async def sleep_until_ns(self, deadline_ns: int, interrupt: "asyncio.Event | None" = None) -> None:
        """Return at `deadline_ns` or just after (asyncio's timers: 1 ms), or at `interrupt`; at once where past."""
        import asyncio  # who only asks for the time, as every client command, does without

        while (left_s := self.seconds_until(deadline_ns)) > 0.0:
            if interrupt is None:
                await asyncio.sleep(left_s)
                continue
            with suppress(TimeoutError):
                await asyncio.wait_for(interrupt.wait(), left_s)
                return


REAL_TIME = Clock()


def monotonic_ns() -> int:
    """Now in real time."""
    return REAL_TIME.monotonic_ns()


def cpu_ns() -> int:
    """CPU time of the calling thread so far: how much it has worked, however seldom the machine let it."""
    return time.thread_time_ns()


def unix_us() -> int:
    """Microseconds since 1970, for SYSTEM_TIME and for a log's wall-clock metadata; never for control."""
    return time.time_ns() // 1000
