"""The lab's bus over real Zenoh sessions on loopback; from other threads to the event loop."""

import asyncio
import os
import subprocess
import sys
import threading
import time
from contextlib import asynccontextmanager

import numpy as np
import pytest
import zenoh

from formation.config import LinkConfig
from formation.messages import Datagram, OperatorReply, OperatorRequest, Truth, Verb
from tests.free_ports import free_port
from tests.wire import peer as wire_peer
from tests.wire.spine import assert_identical
from tests.wire.waiting import PATIENCE_S, in_loop, until
from wire.clock import monotonic_ns
from wire.mavlink.framing import LARGEST_DATAGRAM
from wire.transport.link import LinkCounters
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import BusError, Inbox, Reply, ZenohBus, on_loop


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


REQUEST = OperatorRequest(3, Verb.SHAPE, "line")


def ends() -> tuple[LinkConfig, LinkConfig]:
    """The configurations of one who listens and of one who connects there."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    return LinkConfig(zenoh_listen=(endpoint,), zenoh_connect=(endpoint,)), LinkConfig(zenoh_connect=(endpoint,))


@asynccontextmanager
async def joined(*configs: LinkConfig):
    buses = [await ZenohBus.open(config, "lab") for config in configs]
    try:
        yield buses
    finally:
        for bus in buses:
            await bus.close()


@in_loop
async def test_mavlink_both_ways_by_drone_truth_and_state():
    async with joined(*ends()) as (ground_bus, drone_bus):
        up, down, true, told = (asyncio.Event() for _ in range(4))
        at_ground: list[Datagram] = []
        at_drone: list[Datagram] = []
        ground = ground_bus.ground_link([1, 2], lambda d: (at_ground.append(d), up.set()))
        drone = drone_bus.drone_link(2, lambda d: (at_drone.append(d), down.set()))
        await until(down, lambda: (ground.send(Datagram(1, b"one")), ground.send(Datagram(2, b"two"))))
        await until(up, lambda: drone.send(Datagram(2, b"back")))
        assert set(at_drone) == {Datagram(2, b"two")}
        assert set(at_ground) == {Datagram(2, b"back")}
        assert drone.counters.received == len(at_drone)
        with pytest.raises(KeyError):
            ground.send(Datagram(9, b""))
        truth = Truth(5, 3, *np.arange(6.0).reshape(2, 3), np.array([1.0, 0, 0, 0]), *np.eye(2, 3), True)
        seen: dict[str, object] = {}
        ground_bus.on_truth(lambda m: (seen.update(truth=m), true.set()))
        ground_bus.on_state("main", lambda text: (seen.update(state=text), told.set()))
        await until(true, lambda: drone_bus.publish_truth(truth))
        await until(told, lambda: drone_bus.publish_state("main", "{ü}"))
        assert_identical(truth, seen["truth"])
        assert seen["state"] == "{ü}"


@in_loop
async def test_a_request_is_answered_now_or_later_and_none_for_ever_is_a_timeout():
    async with joined(*ends()) as (ground, operator):

        def handle(request, reply):
            answer = OperatorReply(request.id, True, f"{request.verb} {request.argument}")
            if request.verb is Verb.LAND:
                return
            if request.verb is Verb.SHAPE:
                asyncio.get_running_loop().call_later(0.01, reply, answer)
            else:
                reply(answer)

        ground.serve("main", handle)
        assert await operator.ask("main", REQUEST, PATIENCE_S) == OperatorReply(3, True, "shape line")
        reply = await operator.ask("main", OperatorRequest(4, Verb.STOP), PATIENCE_S)
        assert reply == OperatorReply(4, True, "stop ")
        with pytest.raises(TimeoutError, match=r"lab/gcs/main/do within 0\.5 s"):
            await operator.ask("main", OperatorRequest(5, Verb.LAND), 0.5)


@in_loop
async def test_a_ground_that_starts_after_the_question_gets_it_once():
    listening, connecting = ends()
    async with joined(connecting) as (operator,):
        asked = asyncio.create_task(operator.ask("main", REQUEST, PATIENCE_S))
        async with joined(listening) as (ground,):
            requests: list[OperatorRequest] = []

            def handle(request, reply):
                requests.append(request)
                reply(OperatorReply(request.id, False, "not yet"))

            ground.serve("main", handle)
            assert await asked == OperatorReply(3, False, "not yet")
            assert requests == [REQUEST]


@in_loop
async def test_what_is_too_large_or_no_message_is_refused_unread_and_told():
    async with joined(*ends()) as (sender, receiver):
        got: list[Datagram] = []
        heard = asyncio.Event()
        receiver.on_state("main", lambda _: pytest.fail("a state of a megabyte was read"))
        receiver.serve("main", lambda *_: pytest.fail("a request of a megabyte was read"))
        receiver.serve("second", lambda *_: pytest.fail("what is no request was read"))
        receiver.on_truth(lambda _: pytest.fail("what is no truth was read"))
        receiver.ground_link([1], lambda datagram: (got.append(datagram), heard.set()))
        drone = sender.drone_link(1, lambda _: None)

        def send() -> None:
            sender.publish("gcs/main/state", bytes(1 << 20))
            sender.publish("sim/1/truth", b"\xff\xff")
            drone.send(Datagram(1, bytes(LARGEST_DATAGRAM + 1)))
            drone.send(Datagram(1, bytes(LARGEST_DATAGRAM)))
            callback = zenoh.handlers.Callback(lambda _: None)
            sender._session.get("lab/gcs/main/do", callback, payload=bytes(1 << 20))
            sender._session.get("lab/gcs/second/do", callback, payload=b"\xff")

        await until(heard, send)
        all_told: set[str] = set()
        told = asyncio.Event()

        def look() -> None:
            send()
            all_told.update(event.source for event in receiver.rejections.due(monotonic_ns()))
            if len(all_told) == 5:
                told.set()

        await until(told, look)
        keys = ("gcs/main/state", "uav/1", "gcs/main/do", "sim/*/truth", "gcs/second/do")
        assert all_told == {f"lab/{key}" for key in keys}
        assert {len(datagram.data) for datagram in got} == {LARGEST_DATAGRAM}


@in_loop
async def test_a_flood_on_one_drones_key_costs_no_other_drone_a_datagram():
    async with joined(*ends()) as (sender, receiver):
        got: list[bytes] = []
        here = asyncio.Event()
        ground = receiver.ground_link([1, 2], lambda d: (got.append(d.data) if d.sysid == 2 else None, here.set()))
        flooding, quiet = sender.drone_link(1, lambda _: None), sender.drone_link(2, lambda _: None)
        await until(here, lambda: quiet.send(Datagram(2, b"\xfd")))
        got.clear()
        for k in range(2000):
            flooding.send(Datagram(1, b"\xfd" * 100))
            if k % 50 == 0:
                quiet.send(Datagram(2, bytes([0xFD, k // 50])))
                time.sleep(0.005)  # the receiver stands still, so its queues fill, not those of the sender
        last = asyncio.Event()
        await until(last, lambda: last.set() if len(got) >= 40 else None)
        assert got == [bytes([0xFD, k]) for k in range(40)]
        ground.close()


@in_loop
async def test_a_closed_bus_drops_and_counts():
    (listening, _) = ends()
    bus = await ZenohBus.open(listening, "lab")
    link = bus.ground_link([1], lambda _: None)
    await bus.close()
    bus.publish_state("main", "{}")
    link.send(Datagram(1, b"x"))
    assert (bus.counters.dropped, link.counters.dropped) == (1, 1)
    link.close()


@pytest.mark.parametrize("lab", ["", "a b#", "*"])
def test_a_name_that_is_no_key_is_refused(lab):
    with pytest.raises(BusError, match="lab"):
        asyncio.run(ZenohBus.open(ends()[0], lab))


@in_loop
async def test_a_taken_port_is_refused_in_words():
    listening, _ = ends()
    async with joined(listening):
        with pytest.raises(
            BusError, match=rf"\(process {os.getpid()}\) has the port \(.*Address already in use \(os error 98\)\]\)$"
        ):
            await ZenohBus.open(listening, "lab")


@pytest.mark.processes
@in_loop
async def test_when_the_first_peer_is_killed_the_others_keep_talking_and_it_may_come_back():
    """Gossip: the ground and the drone knew only the mocap's port, and found each other through it."""
    _, connecting = ends()
    port = connecting.zenoh_connect[0].rpartition(":")[2]
    script = [sys.executable, wire_peer.__file__]
    with subprocess.Popen([*script, "mocap", port]) as mocap, subprocess.Popen([*script, "drone", port]) as drone:
        try:
            async with joined(connecting) as (bus,):
                frame, back = asyncio.Event(), asyncio.Event()
                MocapBus(bus).on_frame(lambda _: frame.set())
                link = bus.ground_link([2], lambda _: back.set())
                await until(frame)
                await until(back, lambda: link.send(Datagram(2, b"x")))
                mocap.kill()
                mocap.wait()
                for _ in range(20):
                    back.clear()
                    await until(back, lambda: link.send(Datagram(2, b"x")))
                frame.clear()
                with subprocess.Popen([*script, "mocap", port]) as again:
                    try:
                        await until(frame)
                    finally:
                        again.kill()
        finally:
            mocap.kill()
            drone.kill()


def unnamed(endpoint: str) -> LinkConfig:
    """As of a lab file that says nothing of a bus."""
    return LinkConfig.model_construct(_fields_set=set(), zenoh_connect=(endpoint,))


@in_loop
async def test_listens_where_no_bus_is_named_and_nobody_listens_and_nowhere_else():
    assert not LinkConfig().names_bus
    elsewhere = LinkConfig(zenoh_connect=(f"tcp/127.0.0.1:{free_port()}",))
    assert elsewhere.names_bus
    bus = await ZenohBus.open_or_listen(elsewhere, "lab")
    assert not bus.listens
    assert not bus.is_joined
    await bus.close()
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    first = await ZenohBus.open_or_listen(unnamed(endpoint), "lab")
    second = await ZenohBus.open_or_listen(unnamed(endpoint), "lab")
    try:
        assert (first.listens, second.listens) == (True, False)
        heard = asyncio.Event()
        first.on_state("main", lambda _: heard.set())
        await until(heard, lambda: second.publish_state("main", "{}"))
        assert first.is_joined
        assert second.is_joined
    finally:
        await second.close()
        await first.close()


@pytest.mark.parametrize("verb", [Verb.STOP, Verb.LAND])
@in_loop
async def test_a_flood_of_questions_keeps_no_urgent_request_waiting(verb):
    """Thousands wait, more than are kept; each takes the ground a while; the urgent one is served among the first."""
    async with joined(*ends()) as (ground, operator):
        served: list[Verb] = []

        def handle(request: OperatorRequest, reply: Reply) -> None:
            served.append(request.verb)
            reply(OperatorReply(request.id, True, "done"))

        ground.serve("main", handle)
        await operator.ask("main", OperatorRequest(0, Verb.STATUS), 30.0)
        questions = [OperatorRequest(k, Verb.STATUS) for k in range(800)]
        flood = [asyncio.ensure_future(operator.ask("main", question, 30.0)) for question in questions]
        await asyncio.sleep(0)
        before = len(served)
        assert (await operator.ask("main", OperatorRequest(9999, verb), 30.0)).accepted
        assert served.index(verb) - before < 200  # 256 wait at most, and the urgent one behind them
        for one in flood:
            one.cancel()
        await asyncio.gather(*flood, return_exceptions=True)
