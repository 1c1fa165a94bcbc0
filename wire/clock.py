"""The machine's clock: the only module that reads it."""

import asyncio
import time


def monotonic_ns() -> int:
    """Nanoseconds on the monotonic clock all control runs on; one clock for every process of a machine."""
    return time.monotonic_ns()


def unix_us() -> int:
    """Microseconds since 1970, for SYSTEM_TIME and for a log's wall-clock metadata; never for control."""
    return time.time_ns() // 1000


async def sleep_until_ns(deadline_ns: int) -> None:
    """Return at `deadline_ns` of `monotonic_ns` or just after (asyncio's timers: 1 ms); at once if it has passed."""
    while (left_s := (deadline_ns - monotonic_ns()) * 1e-9) > 0.0:
        await asyncio.sleep(left_s)
