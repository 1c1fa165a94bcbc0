"""Keys that are replaced or revoked while the ground runs: used, or void, from the next look at their folder."""

import asyncio
from datetime import UTC, datetime
from pathlib import Path

from formation.config import LinkConfig
from formation.messages import OperatorReply, OperatorRequest, Verb
from gcs.security.roles import by_role
from tests.free_ports import free_port
from tests.gcs.security.lab import keyed_lab
from wire import clock
from wire.link_messages import GROUND, Address, Heartbeat, MavAutopilot
from wire.mavlink.codec import Codec
from wire.mavlink.signing import REVOKED
from wire.rejections import RejectionLog
from wire.security.private_keys import StampFile
from wire.security.protection import Protection, protection_of
from wire.transport.zenoh_bus import ZenohBus

UP = Codec(Address(2, 1)).encode(Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4))
DOWN = Codec(GROUND).encode(Heartbeat(MavAutopilot.INVALID, 6, 0, 0, 4))


def look(*protections: Protection) -> None:
    """What each process does twice a second."""

    async def attend() -> None:
        tasks = [asyncio.create_task(each.attend(lambda event: None)) for each in protections]
        await asyncio.sleep(0.3)
        for task in tasks:
            task.cancel()

    asyncio.run(attend())


def test_a_new_key_is_used_in_flight_and_a_revoked_drone_is_silent(tmp_path: Path) -> None:
    assert StampFile.PERIOD_S <= 0.5  # so that it is so within a second
    _, folder = keyed_lab(tmp_path)
    ground, drone = protection_of(tmp_path / "keys", "ground"), protection_of(tmp_path / "keys", "drone-2")
    at_ground, aboard = ground.channel(2), drone.channel(2)
    assert at_ground is not None
    assert aboard is not None

    def both_ways() -> bool:
        up, down = aboard.sign(UP, clock.unix_us()), at_ground.sign(DOWN, clock.unix_us())
        return bool(at_ground.verify(up, clock.unix_us()).data and aboard.verify(down, clock.unix_us()).data)

    assert both_ways()
    before = at_ground.key
    folder.rotate("drone-2", datetime.now(UTC))
    assert both_ways()
    look(ground)
    assert both_ways()
    look(drone)
    assert both_ways()
    assert at_ground.key == aboard.key != before
    folder.revoke("drone-2", datetime.now(UTC))
    look(ground)
    assert at_ground.verify(aboard.sign(UP, clock.unix_us()), clock.unix_us()).reject_reason == REVOKED
    other = ground.channel(1)
    assert other is not None
    assert other.sign(DOWN, clock.unix_us())  # the others fly on


def test_a_revoked_operator_is_refused_in_flight(tmp_path: Path) -> None:
    config, folder = keyed_lab(tmp_path)
    ground, answers = protection_of(tmp_path / "keys", "ground"), []

    def handle(request: OperatorRequest, reply: object) -> None:
        reply(OperatorReply(request.id, True, "done"))  # type: ignore[operator]

    handler = by_role(config, handle, RejectionLog(), clock.monotonic_ns, ground.names)
    hold = OperatorRequest(1, Verb.HOLD, source="anna.1 (anna@pc)")
    handler(hold, answers.append)
    folder.revoke("anna", datetime.now(UTC))
    look(ground)
    handler(hold, answers.append)
    assert [answer.text for answer in answers] == ["done", "the keys of anna.1 are revoked"]


def test_the_stamps_of_a_running_process_are_on_disk(tmp_path: Path) -> None:
    """What was accepted before a restart is not accepted after it: by files alone."""
    keyed_lab(tmp_path)
    ground, drone = protection_of(tmp_path / "keys", "ground"), protection_of(tmp_path / "keys", "drone-2")
    aboard = drone.channel(2)
    recorded = [ground.channel(2).sign(DOWN, clock.unix_us()) for _ in range(500)]
    assert all(aboard.verify(data, clock.unix_us()).data for data in recorded)
    look(drone)
    restarted = protection_of(tmp_path / "keys", "drone-2").channel(2)
    assert not any(restarted.verify(data, clock.unix_us()).data for data in recorded)


def test_a_revoked_publisher_is_silent_within_a_second_and_others_lose_nothing(tmp_path: Path) -> None:
    """Both keep publishing on a bus that goes on; a restart of nobody."""
    _, folder = keyed_lab(tmp_path)
    endpoint, heard = f"tls/127.0.0.1:{free_port()}", {"mocap/state": [], "gcs/main/state": []}

    async def fly() -> None:
        async def joined(identity: str, link: LinkConfig) -> ZenohBus:
            return await ZenohBus.open(link, "lab", protection=protection_of(tmp_path / "keys", identity))

        joins = LinkConfig(zenoh_connect=(endpoint,))
        ground = await joined("ground", LinkConfig(zenoh_listen=(endpoint,), zenoh_connect=()))
        mocap, judge = await joined("mocap", joins), await joined("judge", joins)
        buses = (ground, mocap, judge)
        attending = [asyncio.create_task(bus.protection.attend(lambda event: None)) for bus in buses]
        for key, numbers in heard.items():
            judge.listen(key, lambda sample, numbers=numbers: numbers.append(int(sample.payload.to_bytes())), 1000)
        async with asyncio.timeout(30.0):
            while not (mocap.has_subscribers("mocap/state") and ground.has_subscribers("gcs/main/state")):
                await asyncio.sleep(0.05)
        sent = 0
        for turn in range(300):  # 3 s; revoked after 0.5 s, so silent from 1.5 s on
            if turn == 50:
                folder.revoke("mocap", datetime.now(UTC))
            mocap.publish("mocap/state", str(turn).encode())
            ground.publish("gcs/main/state", str(turn).encode())
            sent += 1
            await asyncio.sleep(0.01)
        async with asyncio.timeout(10.0):
            while len(heard["gcs/main/state"]) < sent:
                await asyncio.sleep(0.05)
        assert judge.rejections.due(clock.monotonic_ns())[0].text.count("mocap.1, whose keys are revoked") == 1
        for task in attending:
            task.cancel()
        for bus in buses:
            await bus.close()

    asyncio.run(fly())
    assert heard["gcs/main/state"] == list(range(300))
    assert heard["mocap/state"][:40] == list(range(40))
    assert max(heard["mocap/state"]) < 150
