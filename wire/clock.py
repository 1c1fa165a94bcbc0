"""The machine's clock: the only module that reads it."""

import asyncio
import time
import uuid
from pathlib import Path

_BOOT = Path("/proc/sys/kernel/random/boot_id")


def monotonic_ns() -> int:
    """Nanoseconds on the monotonic clock all control runs on; one clock for every process of a machine."""
    return time.monotonic_ns()


def name() -> bytes:
    """Which clock `monotonic_ns` reads: the same name means the same clock, another one means another machine's."""
    try:
        return _BOOT.read_bytes().strip()
    except OSError:  # no Linux: the machine's own number, though its clock starts anew with each boot
        return f"{uuid.getnode():x}".encode()


def unix_us() -> int:
    """Microseconds since 1970, for SYSTEM_TIME and for a log's wall-clock metadata; never for control."""
    return time.time_ns() // 1000


async def sleep_until_ns(deadline_ns: int) -> None:
    """Return at `deadline_ns` of `monotonic_ns` or just after (asyncio's timers: 1 ms); at once if it has passed."""
    while (left_s := (deadline_ns - monotonic_ns()) * 1e-9) > 0.0:
        await asyncio.sleep(left_s)
