"""`gcs ros2` as a process: poses from the mocap process and the ground's log, both off the bus, into a ROS 2 graph.

It is an observer, and asks the ground for what the graph's services ask of it: to hold, or to land.
"""

import asyncio
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Protocol, TypeVar

from formation import topics
from formation.config import LabConfig
from formation.messages import LabFrame, OperatorRequest, PhaseChange, Verb
from formation.requests import answer_s
from wire import clock as clocks
from wire.clock import Clock
from wire.ground_state import GroundState, decode
from wire.logs.live import QUEUED, LiveLog, keys
from wire.process.daemon import GROUND_REMEDY, EventSink, Precondition, Stop, beside, first_of, report_missing
from wire.process.system import own_name
from wire.ros2.flight import TF_STATIC, Flight, Level, Shown, diagnostics, fault_status, phase_status, static_frames
from wire.ros2.message_types import Values
from wire.ros2.node import Graph, Node, Reply
from wire.schema import schema_of
from wire.security.protection import Protection
from wire.transport.mocap_bus import MocapBus
from wire.transport.zenoh_bus import ZenohBus

T = TypeVar("T")
SOURCE = "ros2"
SERVICE = "std_srvs/srv/Trigger"
SERVED = (Verb.HOLD, Verb.LAND)
"""A ROS graph has no roles: nobody in it may start anything."""
LOGGED = {topic.name: schema_of(topic.type) for topic in (topics.STATE, topics.REFERENCE, topics.COMMAND)}
ROUTER_REMEDY = "start it with `ros2 run rmw_zenoh_cpp rmw_zenohd`; a lab's own bus is none"


class Publishes(Protocol):
    """A topic's publisher."""

    has_subscribers: bool

    def publish(self, values: Values) -> None:
        """Publish a message."""


class Shows:
    """Makes a flight's messages of what comes from the bus; publishes those that somebody subscribes to."""

    def __init__(self, flight: Flight, clock: Clock) -> None:
        self.begun = False
        """Whether the ground's log has come."""
        self.messages = 0
        self.types = tuple(flight.types.items())
        """(topic, type) of all that is published."""
        self.publishers: Mapping[str, Publishes] = {}
        """Each topic's, once the graph is joined; nothing is to be received before."""
        self._flight, self._clock = flight, clock
        self._ahead_ns = clock.pair().ahead_ns
        self._log = LiveLog(LOGGED)
        self._decoders: dict[int, Callable[[bytes], object]] = {}
        self._state = ""
        self._faults: dict[str, Values] = {}

    def receive_frame(self, frame: LabFrame) -> None:
        """A frame, its stamps on our clock."""
        self._publish_all(self._flight.of(frame, self._ahead_ns))

    def receive_head(self, head: bytes) -> None:
        """What the ground's log holds."""
        if self._log.receive_head(head):
            self.begun = True
            self._decoders = {
                number: LOGGED[described.topic].written(described.descriptor_set).decode
                for number, described in self._log.channels.items()
            }

    def receive_chunk(self, chunk: bytes) -> None:
        """The newest moments of the log; of each topic the last message is shown."""
        if not any(publisher.has_subscribers for publisher in self.publishers.values()):
            return
        newest = {number: data for number, _, data in self._log.messages(chunk)}
        for number, read in self._decoders.items():
            if number in newest:
                self._publish_all(self._flight.of(read(newest[number]), self._log.ahead_ns))

    def receive_state(self, text: str) -> None:
        """The ground's published state; the newest is read once a second."""
        self._state = text

    def tick(self) -> None:
        """Once a second: what stands still, and what changes slowly. ValueError for a state of another version."""
        pair = self._clock.pair()
        self._ahead_ns = pair.ahead_ns
        self._publish_all([static_frames(pair.unix_ns)])
        text, self._state = self._state, ""
        if text:
            self._publish_all(self._slow(decode(text), pair.unix_ns))

    def _slow(self, state: GroundState, unix_ns: int) -> Iterator[Shown]:
        faults = {str(status[1]): status for status in (fault_status(alarm, is_over=False) for alarm in state.alarms)}
        over = [(Level.OK, *status[1:]) for name, status in self._faults.items() if name not in faults]
        self._faults = faults
        phase = phase_status(PhaseChange(state.phase, state.cause, state.cause_code))
        yield diagnostics((phase, *faults.values(), *over), unix_ns)
        for drone in state.drones:
            yield self._flight.battery(drone.body, drone.battery_v, drone.battery, unix_ns)

    def _publish_all(self, shown: Iterable[Shown]) -> None:
        for topic, values in shown:
            publisher = self.publishers[topic]
            if publisher.has_subscribers:
                publisher.publish(values)
                self.messages += 1


async def run(
    config: LabConfig, name: str, graph: Graph, report: EventSink, protection: Protection, clock: Clock
) -> int:
    """Publish until SIGINT or SIGTERM; how many messages. Raises BusError, ValueError for bodies of one name."""
    shows, stop = Shows(Flight(config), clock), Stop(report)
    bus = await ZenohBus.open(config.link.joined, config.name, protection=protection)
    awaited = (
        Precondition(f"ROS 2's router at {graph.router}", lambda: bool(shows.publishers), ROUTER_REMEDY),
        Precondition(f"the log of ground {name!r}", lambda: shows.begun, GROUND_REMEDY),
    )
    try:
        async with beside(report_missing(SOURCE, awaited, report)):
            await first_of(_publish(shows, graph, bus, name, clock, report), stop.wait())
    finally:
        await bus.close()
    return shows.messages


async def _publish(shows: Shows, graph: Graph, bus: ZenohBus, name: str, clock: Clock, report: EventSink) -> None:
    """Publish until cancelled."""
    node = await Node.open(graph)
    try:
        async with asyncio.TaskGroup() as requests:
            shows.publishers = {topic: node.publisher(topic, kind, topic == TF_STATIC) for topic, kind in shows.types}
            _listen(bus, name, shows, clock)
            for verb in () if graph.dds else SERVED:  # the bridge routes no service that no DDS node has
                node.serve(verb.command_name, SERVICE, _service(verb, bus, name, requests))
            await _every_second(shows, bus, clock, report)
    finally:
        await node.close()


def _listen(bus: ZenohBus, name: str, shows: Shows, clock: Clock) -> None:
    head_key, chunk_key = keys(name)

    def checked(key: str, receive: Callable[[T], None]) -> Callable[[T], None]:
        def receive_checked(message: T) -> None:
            try:
                receive(message)
            except ValueError:
                bus.reject(key, "frame or log of another release, or of other bodies than the lab's")

        return receive_checked

    receive_head, receive_chunk = checked(head_key, shows.receive_head), checked(chunk_key, shows.receive_chunk)
    bus.listen(head_key, lambda sample: receive_head(sample.payload.to_bytes()), limit=1)
    bus.listen(chunk_key, lambda sample: receive_chunk(sample.payload.to_bytes()), limit=QUEUED)
    bus.on_state(name, shows.receive_state)
    MocapBus(bus, clock).on_frame(checked("mocap/frame", shows.receive_frame), QUEUED)


async def _every_second(shows: Shows, bus: ZenohBus, clock: Clock, report: EventSink) -> None:
    while True:
        try:
            shows.tick()
        except ValueError as error:  # of a ground of another version
            bus.reject("state", str(error))
        now_ns = clock.monotonic_ns()
        for event in bus.rejections.due(now_ns):
            report(event)
        await clock.sleep_until_ns(now_ns + 1_000_000_000)


def _service(verb: Verb, bus: ZenohBus, name: str, tasks: asyncio.TaskGroup) -> Callable[[Reply], None]:
    async def ask(reply: Reply) -> None:
        request = OperatorRequest(clocks.unix_us(), verb, "", f"ROS 2 by {own_name()}")
        try:
            answer = await bus.ask(name, request, answer_s(verb))
            reply((answer.accepted, answer.text))
        except TimeoutError as error:
            reply((False, f"no ground answers: {error}"))

    def handle(reply: Reply) -> None:
        tasks.create_task(ask(reply))

    return handle
