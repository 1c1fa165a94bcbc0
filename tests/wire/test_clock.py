"""The machine's clock."""

import asyncio

import pytest

from wire.clock import REAL_TIME, Clock, monotonic_ns


def test_a_deadline_that_has_passed_does_not_wait():
    asyncio.run(asyncio.wait_for(REAL_TIME.sleep_until_ns(monotonic_ns() - 10**12), timeout=5.0))


def test_a_slowed_clock_shows_its_share_of_the_time_to_every_process():
    quarter = Clock(0.25)
    before_ns = monotonic_ns()
    shown_ns = [quarter.monotonic_ns(), Clock(0.25).monotonic_ns()]
    after_ns = monotonic_ns()
    assert before_ns // 4 - 2 <= shown_ns[0] <= shown_ns[1] <= after_ns // 4 + 2


def test_a_second_of_a_slowed_clock_takes_the_machine_longer():
    quarter = Clock(0.25)
    left_s = quarter.seconds_until(quarter.monotonic_ns() + 1_000_000_000)
    assert left_s == pytest.approx(4.0, abs=0.5)
    assert REAL_TIME.seconds_until(monotonic_ns() - 1) == 0.0


def test_sleep_on_a_slowed_clock_ends_at_its_own_deadline():
    async def run() -> tuple[int, int]:
        quarter, start_ns = Clock(0.25), monotonic_ns()
        deadline_ns = quarter.monotonic_ns() + 3_000_000
        await quarter.sleep_until_ns(deadline_ns)
        return quarter.monotonic_ns() - deadline_ns, monotonic_ns() - start_ns

    late_ns, taken_ns = asyncio.run(run())
    assert late_ns >= 0
    assert taken_ns >= 4 * 3_000_000 - 10
