"""Our node with `pyzeros`, another implementation of rmw_zenoh's keys and of CDR, both ways.

At night alone: its codecs are compiled by a C compiler, for a minute.
"""

import asyncio

import pytest

from tests.wire.ros2 import peers
from tests.wire.ros2.peers import DOMAIN, node, opened, until
from wire.ros2.message_types import message_type

pytestmark = pytest.mark.nightly
POSE = message_type("geometry_msgs/msg/PoseStamped")
VALUES = (345, "lab", 1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8)
SENT = 1000


def test_poses_go_both_ways_and_a_service_is_called(tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)  # where the compiled codecs go
    import pyzeros
    from asyncio_for_robotics import Scope
    from ros2_pyterfaces.cydr.geometry_msgs.msg import PoseStamped
    from ros2_pyterfaces.cydr.std_srvs.srv import Trigger

    theirs_heard: list[PoseStamped] = []
    ours_heard: list[tuple] = []

    async def run(endpoint: str) -> tuple[bool, bytes]:
        async with Scope(), node(endpoint, "/swarm") as ours:
            theirs = pyzeros.Session("peer", opened("client", endpoint), domain_id=DOMAIN)
            publisher = ours.publisher("left/pose", POSE.name)
            pyzeros.Sub(PoseStamped, "/swarm/left/pose", session=theirs).asap_callback.append(theirs_heard.append)
            ours.subscribe("/right/pose", lambda _name, data, _ns: ours_heard.append(POSE.decode(data)))
            back = pyzeros.Pub(PoseStamped, "/right/pose", session=theirs)
            ours.serve("hold", "std_srvs/srv/Trigger", lambda reply: reply((True, "holding")))
            client = pyzeros.Client(Trigger, "/swarm/hold", session=theirs)
            await asyncio.wait_for(client.wait_for_service(), 30.0)
            await until(lambda: publisher.has_subscribers and back.zenoh_pub.matching_status.matching)
            for number in range(SENT):
                publisher.publish((number, *VALUES))
                back.publish(PoseStamped.deserialize(POSE.encode((number, *VALUES))))
                await asyncio.sleep(0.002)
            await until(lambda: len(theirs_heard) == len(ours_heard) == SENT)
            reply = await asyncio.wait_for(client.call_async(Trigger.Request()), 30.0)
            theirs.close()
            return bool(reply.success), reply.message

    with peers.router() as endpoint:
        assert asyncio.run(run(endpoint)) == (True, b"holding")
    assert ours_heard == [(number, *VALUES) for number in range(SENT)]
    assert [bytes(message.serialize()) for message in theirs_heard] == [POSE.encode(pose) for pose in ours_heard]
