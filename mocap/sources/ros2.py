"""Poses from a ROS 2 graph, without ROS: PoseStamped or Odometry, a topic a body, or motion_capture_tracking's array.

A message's header stamp is when its poses were exposed, on the publisher's clock; that clock is laid beside ours by the
quickest messages. Poses of one stamp, or nearly, are one frame.
"""

import asyncio
import struct
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

from formation.config import LabConfig
from formation.messages import Severity
from formation.mocap_config import BODY, Ros2Config
from mocap.sources.numbered import BodyList
from mocap.sources.pose_frames import MOST_BODIES, Assembling, Expiry, Pacing, PoseFrames
from mocap.sources.rosbag import POSE_AT
from mocap.sources.source import Feed, SourceStatus, seconds
from wire.ros2.message_types import CdrError, MessageType, Values, message_type, ros_name
from wire.ros2.node import Graph, Node

_POSE = struct.Struct(">7d")
_WATCH_S = 1.0
ARRAY = "motion_capture_tracking_interfaces/msg/NamedPoseArray"
ARRAYS = (ARRAY, f"{ARRAY}V2")
"""Both versions; which one motion_capture_tracking publishes is its setting `poses_version`."""


class Ros2Source:
    """A `Source`."""

    def __init__(self, config: LabConfig, feed: Feed) -> None:
        self._config = config.mocap.ros2 or Ros2Config()
        self._topics = _topics(config, self._config)
        self._types = {kind.dds_name: kind for kind in map(message_type, (*ARRAYS, *POSE_AT))}
        self._feed = feed
        how = Assembling(
            feed=feed,
            pacing=Pacing(1e9 / config.mocap.rate_hz),
            assemble_ns=config.mocap.assemble_ns,
            latency_ns=round(config.mocap.constant_latency_s * 1e9),
            repeats_are_lost=config.mocap.repeats_are_lost,
        )
        self._pacing, self._frames = how.pacing, PoseFrames(how)
        self._expiry: Expiry | None = None
        self._bodies = tuple(vehicle.body for vehicle in config.vehicles)
        self._body_list = BodyList(self._bodies, feed)
        self._router = f"tcp/{self._config.host}:{self._config.port}"
        self._status = SourceStatus(server=f"{self._router}, domain {self._config.domain}")
        self._node: Node | None = None
        self._was_joined: bool | None = None

    async def run(self) -> None:
        """Receive until cancelled."""
        self._expiry = Expiry(self._frames, self._feed.clock)
        late = asyncio.get_running_loop().call_later(_WATCH_S, self._note_joined, False)
        try:
            dds_type = self._config.dds_type
            graph = Graph(self._router, self._config.domain, node="formation_mocap", dds=dds_type is not None)
            dds_name = "" if dds_type is None else message_type(dds_type).dds_name
            node = self._node = await Node.open(graph, self._feed.clock)
        finally:
            late.cancel()
        try:
            for topic, body in self._topics.items():
                node.subscribe(topic, partial(self.receive, body), dds_name)
            while True:
                self._note_joined(node.is_joined)
                if self._frames.rows.names:
                    self._body_list.receive(self._frames.rows.names)
                await asyncio.sleep(_WATCH_S)
        finally:
            self._expiry.cancel()
            await node.close()

    def status(self) -> SourceStatus:
        """How it is doing."""
        frames, now_ns = self._frames, self._feed.clock.monotonic_ns()
        return replace(
            self._status,
            connected=self._node is not None and self._node.is_joined,
            lost=self._pacing.lost,
            latency_s=seconds(frames.latency_ns),
            uncertainty_s=seconds(frames.uncertainty_ns(now_ns)),
            bodies=frames.rows.names,
        )

    def receive(self, body: str, dds_name: str, data: bytes, now_ns: int) -> None:
        """A message of a topic: the body's, or, of an array, of the bodies that it names."""
        kind = self._types.get(dds_name)
        if kind is None:
            self._feed.reject("message of a type that holds no poses that are read")
            return
        try:
            values = kind.decode(data)
        except CdrError:
            self._feed.reject("message that is none of its type")
            return
        stamp_ns = values[0] * 1_000_000_000 + values[1]
        for theirs, pose in _poses(kind, body, values):
            row = self._row(theirs)
            if row is not None:
                self._frames.receive(row, stamp_ns, pose, now_ns)
        self._frames.deliver(now_ns)
        if self._expiry is not None:
            self._expiry.set()

    def _row(self, theirs: str) -> int | None:
        rows = self._frames.rows
        is_known, row = rows.find(theirs)
        if is_known:
            return row
        name = self._feed.name(theirs)
        if rows.is_full and name not in self._bodies:
            self._feed.reject(f"pose of more than {MOST_BODIES} bodies")
            return None
        return rows.add(theirs, name)

    def _note_joined(self, is_joined: bool) -> None:
        if is_joined == self._was_joined:
            return
        self._was_joined = is_joined
        if is_joined:
            self._feed.report(Severity.INFO, f"connected to {self._router}")
        else:
            text = f"no ROS 2 router at {self._router}: start rmw_zenohd there; trying again"
            self._feed.report(Severity.WARNING, text)


def _topics(config: LabConfig, ros2: Ros2Config) -> dict[str, str]:
    """Whose poses each topic has, by the source's own names; empty for an array, which names them."""
    names = {vehicle.body: config.mocap.source_name(vehicle.body) for vehicle in config.vehicles}
    if BODY in ros2.topic:
        topics = {ros2.topic.replace(BODY, ros_name(name)): name for name in names.values()}
    else:
        topics = {ros2.topic: ""}
    leader = names[config.leader.body]
    return topics if ros2.leader is None else {t: n for t, n in topics.items() if n != leader} | {ros2.leader: leader}


def _poses(kind: MessageType, body: str, values: Values) -> Iterator[tuple[str, bytes]]:
    """(name, seven doubles) of each body in a message; ROS has quaternions as x y z w."""
    if kind.name in ARRAYS:
        yield from ((name, _POSE.pack(*pose)) for name, *pose in values[-1])
    else:
        at = POSE_AT[kind.name]
        yield body, _POSE.pack(*values[at : at + 7])
