"""From other threads to the event loop."""

import asyncio
import threading

from tests.wire.waiting import in_loop, until
from wire.transport.link import LinkCounters
from wire.transport.zenoh_bus import Inbox, on_loop


@in_loop
async def test_the_latest_wins_where_the_loop_is_late():
    got: list[int] = []
    counters = LinkCounters()
    inbox = Inbox(asyncio.get_running_loop(), got.append, counters, 1)
    thread = threading.Thread(target=lambda: [inbox.enqueue(i) for i in range(100)])
    thread.start()
    thread.join()
    done = asyncio.Event()
    asyncio.get_running_loop().call_soon(done.set)
    await until(done)
    assert got == [99]
    assert (counters.received, counters.dropped) == (1, 99)


@in_loop
async def test_every_item_of_many_threads_arrives_once_and_in_its_threads_order():
    got: list[tuple[int, int]] = []
    counters = LinkCounters()
    inbox = Inbox(asyncio.get_running_loop(), got.append, counters, 100_000)
    threads = [
        threading.Thread(target=lambda name=name: [inbox.enqueue((name, i)) for i in range(2000)]) for name in range(4)
    ]
    for thread in threads:
        thread.start()
    done = asyncio.Event()
    await until(done, lambda: done.set() if len(got) == 8000 else None)
    for thread in threads:
        thread.join()
    for name in range(4):
        assert [i for n, i in got if n == name] == list(range(2000))
    assert (counters.received, counters.dropped) == (8000, 0)


@in_loop
async def test_a_closed_inbox_delivers_nothing_more():
    got: list[int] = []
    loop = asyncio.get_running_loop()
    inbox = Inbox(loop, got.append, LinkCounters(), 10)
    inbox.enqueue(1)
    inbox.close()
    done = asyncio.Event()
    loop.call_soon(done.set)
    await until(done)
    assert got == []


def test_a_loop_that_has_closed_is_told_nothing():
    loop = asyncio.new_event_loop()
    loop.close()
    on_loop(loop, lambda: None)
