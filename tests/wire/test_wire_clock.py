"""The machine's clock."""

import asyncio

from wire.clock import monotonic_ns, sleep_until_ns, unix_us


def test_sleep_ends_at_the_deadline_not_before():
    async def run() -> int:
        deadline_ns = monotonic_ns() + 3_000_000
        await sleep_until_ns(deadline_ns)
        return monotonic_ns() - deadline_ns

    assert asyncio.run(run()) >= 0


def test_a_deadline_that_has_passed_does_not_wait():
    asyncio.run(asyncio.wait_for(sleep_until_ns(monotonic_ns() - 10**12), timeout=5.0))


def test_the_wall_clock_is_in_this_century():
    assert 1_600_000_000_000_000 < unix_us() < 4_200_000_000_000_000
