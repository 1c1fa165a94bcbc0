"""The date in a log: once a minute the wall clock beside the monotonic clock, on which everything runs."""

from formation import topics
from wire.clock import Clock
from wire.logs.mcap_log import LogWriter

DATE_NS = 60_000_000_000


async def record_dates(log: LogWriter, clock: Clock) -> None:
    """Record a pair of both clocks at once, and one a minute; for ever."""
    while True:
        pair = clock.pair()
        log.write(topics.CLOCK, pair, pair.monotonic_ns)
        await clock.sleep_until_ns(pair.monotonic_ns + DATE_NS)
