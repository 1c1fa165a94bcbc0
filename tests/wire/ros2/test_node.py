"""A node of ours with another by plain Zenoh, through a router: rmw_zenoh's keys, attachments and tokens."""

import asyncio

import pytest

from tests.free_ports import free_port
from tests.wire.ros2 import peers
from tests.wire.ros2.peers import ATTACHED, DOMAIN, POSE, TRIGGER, call, node, opened, until
from wire.errors import BusError
from wire.ros2.message_types import message_type, ros_name
from wire.ros2.node import Graph, Node

POSE_STAMPED = message_type("geometry_msgs/msg/PoseStamped")
VALUES = (12, 345, "lab", 1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8)
SENT = 300


@pytest.fixture
def endpoint():
    with peers.router() as at:
        yield at


def test_each_message_is_published_with_number_time_and_one_gid(endpoint: str) -> None:
    heard: list[tuple[bytes, bytes]] = []

    async def run() -> None:
        async with node(endpoint, "/swarm") as ours:
            publisher = ours.publisher("left/pose", POSE_STAMPED.name)
            session = opened("client", endpoint)
            session.declare_subscriber(
                f"{DOMAIN}/swarm/left/pose/{POSE}",
                lambda sample: heard.append((sample.payload.to_bytes(), sample.attachment.to_bytes())),
            )
            await until(lambda: publisher.has_subscribers)
            for number in range(SENT):
                publisher.publish((number, *VALUES[1:]))
                await asyncio.sleep(0.001)
            await until(lambda: len(heard) == SENT)
            session.close()

    asyncio.run(run())
    assert [POSE_STAMPED.decode(data) for data, _ in heard] == [(number, *VALUES[1:]) for number in range(SENT)]
    attached = [ATTACHED.unpack(data) for _, data in heard]
    assert [number for number, *_ in attached] == list(range(1, SENT + 1))
    assert {(size, gid) for _, _, size, gid in attached} == {(16, attached[0][3])}
    assert 1_600_000_000_000_000_000 < attached[0][1] < attached[-1][1]


def test_every_message_of_a_topic_is_received_of_whatever_type(endpoint: str) -> None:
    heard: list[tuple[str, tuple]] = []

    async def run() -> None:
        async with node(endpoint) as ours:
            ours.subscribe("/left/pose", lambda name, data, _: heard.append((name, POSE_STAMPED.decode(data))))
            session = opened("client", endpoint)
            publisher = session.declare_publisher(f"{DOMAIN}/left/pose/{POSE}")
            await until(lambda: publisher.matching_status.matching)
            for number in range(SENT):
                publisher.put(POSE_STAMPED.encode((number, *VALUES[1:])))
                await asyncio.sleep(0.001)
            await until(lambda: len(heard) == SENT)
            session.close()

    asyncio.run(run())
    assert heard == [("geometry_msgs::msg::dds_::PoseStamped_", (number, *VALUES[1:])) for number in range(SENT)]


def test_a_graph_on_dds_has_topics_for_keys_and_its_types_are_given(endpoint: str) -> None:
    """As zenoh-bridge-ros2dds has them; DDS counts the padding in the last bytes of the CDR's head."""
    heard: list[tuple[str, tuple]] = []
    shown: list[tuple] = []

    async def run() -> list[object]:
        ours = await Node.open(Graph(endpoint, 99, "/swarm", dds=True))
        session = opened("client", endpoint)
        ours.subscribe(
            "/cf7/pose", lambda name, data, _: heard.append((name, POSE_STAMPED.decode(data))), "PoseStamped"
        )
        publisher, theirs = ours.publisher("left/pose", POSE_STAMPED.name), session.declare_publisher("cf7/pose")
        session.declare_subscriber("swarm/left/pose", lambda s: shown.append(POSE_STAMPED.decode(s.payload.to_bytes())))
        await until(lambda: publisher.has_subscribers and theirs.matching_status.matching)
        publisher.publish(VALUES)
        theirs.put(bytes((0, 1, 0, 3)) + POSE_STAMPED.encode(VALUES)[4:])
        await until(lambda: heard and shown)
        tokens = await asyncio.to_thread(lambda: list(session.liveliness().get("@ros2_lv/**", timeout=2.0)))
        await ours.close()
        session.close()
        return tokens

    assert asyncio.run(run()) == []
    assert (heard, shown) == ([("PoseStamped", VALUES)], [VALUES])


def test_service_answers_with_the_number_and_gid_of_who_asks(endpoint: str) -> None:
    async def run() -> tuple[bytes, bytes]:
        async with node(endpoint) as ours:
            ours.serve("hold", "std_srvs/srv/Trigger", lambda reply: reply((True, "holding")))
            session = opened("client", endpoint)
            answer = (await call(session, "/hold")).ok
            session.close()
            return answer.payload.to_bytes(), answer.attachment.to_bytes()

    data, attached = asyncio.run(run())
    assert data == bytes((0, 1, 0, 0, 1, 0, 0, 0, 8, 0, 0, 0)) + b"holding\0"
    number, _, size, gid = ATTACHED.unpack(attached)
    assert (number, size, gid) == (5, 16, bytes(range(16)))


def test_request_that_is_none_is_answered_by_an_error(endpoint: str) -> None:
    async def run() -> str:
        async with node(endpoint) as ours:
            ours.serve("hold", "std_srvs/srv/Trigger", lambda reply: reply((True, "")))
            session = opened("client", endpoint)
            answer = (await call(session, "/hold", request=b"arm")).err
            session.close()
            return answer.payload.to_string()

    assert "std_srvs/srv/Trigger_Request: no CDR" in asyncio.run(run())


def test_graph_has_the_node_its_topics_and_services(endpoint: str) -> None:
    async def run() -> list[list[str]]:
        async with node(endpoint, "/swarm") as ours:
            ours.publisher("left/pose", POSE_STAMPED.name)
            ours.publisher("/tf_static", "tf2_msgs/msg/TFMessage", latched=True)
            ours.serve("hold", "std_srvs/srv/Trigger", lambda reply: reply((True, "")))
            session = opened("client", endpoint)
            keys: list[str] = []
            while len(keys) < 4:
                replies = await asyncio.to_thread(lambda: list(session.liveliness().get("@ros2_lv/**")))
                keys = sorted(str(reply.ok.key_expr) for reply in replies)
            session.close()
            return [key.split("/") for key in keys]

    tokens = {"/".join(token[5:]) for token in asyncio.run(run())}
    frames = message_type("tf2_msgs/msg/TFMessage")
    assert tokens == {
        "NN/%/%swarm/formation",
        f"MP/%/%swarm/formation/%swarm%left%pose/{POSE}/::,10:,:,:,,",
        f"MP/%/%swarm/formation/%tf_static/{frames.dds_name}/{frames.hash}/:1:,1:,:,:,,",
        f"SS/%/%swarm/formation/%swarm%hold/{TRIGGER}/::,10:,:,:,,",
    }


def test_a_node_waits_for_its_router_and_a_lab_s_own_bus_is_none() -> None:
    """Both use port 7447 where nothing else is said."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"

    async def run() -> None:
        opening = asyncio.create_task(Node.open(Graph(endpoint, DOMAIN)))
        await asyncio.sleep(0.3)
        bus = await asyncio.to_thread(opened, "peer", endpoint)
        await asyncio.sleep(1.5)
        assert not opening.done()
        await asyncio.to_thread(bus.close)
        router = await asyncio.to_thread(opened, "router", endpoint)
        ours = await asyncio.wait_for(opening, 30.0)
        assert ours.is_joined
        await asyncio.to_thread(router.close)
        await until(lambda: not ours.is_joined)
        router = await asyncio.to_thread(opened, "router", endpoint)
        await until(lambda: ours.is_joined)
        await asyncio.to_thread(router.close)
        await ours.close()

    asyncio.run(run())


def test_what_is_no_endpoint_is_an_error_that_names_it() -> None:
    with pytest.raises(BusError, match="ROS 2's router nowhere: "):
        asyncio.run(Node.open(Graph("nowhere")))


@pytest.mark.parametrize(("name", "theirs"), [("left", "left"), ("cf-1.a", "cf_1_a"), ("7", "_7")])
def test_names_are_those_that_ros_allows(name: str, theirs: str) -> None:
    assert ros_name(name) == theirs
