"""A ROS 2 graph in a box: its router, and a node that publishes poses as vrpn_mocap or motion_capture_tracking does."""

import asyncio
from collections.abc import Iterator

import zenoh

from formation.messages import RawFrame
from formation.mocap_config import BODY, MocapConfig, Ros2Config
from mocap.sources.ros2 import ARRAY
from sim.cameras.servers.server import Server, ServerClock
from wire.ros2.message_types import Values, ros_name
from wire.ros2.node import Graph, Node, Publisher
from wire.transport.zenoh_session import zenoh_config

WORLD = "world"
SINGLE = "geometry_msgs/msg/PoseStamped"


def ros2_server(config: MocapConfig) -> Server:
    """Where the lab file's client looks for it."""
    return Ros2Server(config.ros2 or Ros2Config())


class Ros2Server:
    """Bodies out of sight are left out."""

    def __init__(self, ros2: Ros2Config) -> None:
        self._ros2 = ros2
        self._time = ServerClock()
        self._node: Node | None = None
        self._publishers: dict[str, Publisher] = {}

    async def start(self) -> None:
        """Listen; OSError where the address is taken."""
        endpoint = f"tcp/{self._ros2.host}:{self._ros2.port}"
        config = zenoh_config({"mode": "router", "listen/endpoints": [endpoint], "scouting/multicast/enabled": False})
        try:
            session = await asyncio.to_thread(zenoh.open, config)
        except zenoh.ZError as error:
            raise OSError(str(error)) from error
        self._node, self._publishers = Node(session, Graph(endpoint, self._ros2.domain, node="mocap")), {}

    def publish(self, frame: RawFrame) -> None:
        """One exposure."""
        stamp = divmod(self._time.at_ns(frame.t_capture_ns), 1_000_000_000)
        poses = list(_poses(frame))
        if BODY in self._ros2.topic:
            for name, pose in poses:
                topic = self._ros2.topic.replace(BODY, ros_name(name))
                self._publisher(topic, SINGLE).publish((*stamp, WORLD, *pose))
        else:
            named = tuple((name, *pose) for name, pose in poses)
            self._publisher(self._ros2.topic, ARRAY).publish((*stamp, WORLD, named))

    async def close(self) -> None:
        """Listen no more."""
        if self._node is not None:
            await self._node.close()
            self._node = None

    def _publisher(self, topic: str, type_name: str) -> Publisher:
        publisher = self._publishers.get(topic)
        if publisher is None:
            assert self._node is not None, "started before it publishes"
            publisher = self._publishers[topic] = self._node.publisher(topic, type_name)
        return publisher


def _poses(frame: RawFrame) -> Iterator[tuple[str, Values]]:
    """Name and geometry_msgs/Pose of each body that is seen."""
    rows = zip(frame.bodies, frame.pos_mocap_m.tolist(), frame.q_mocap_from_marker.tolist(), frame.seen, strict=True)
    for name, pos, (w, *xyz), seen in rows:
        if seen:
            yield name, (*pos, *xyz, w)
