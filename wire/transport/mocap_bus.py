"""The motion capture's part of the lab's bus: raw frames in, lab frames out, state and events of the mocap process.

    <lab>/mocap/raw                     RawFrame, from whoever has the cameras, to the mocap process
    <lab>/mocap/frame                   LabFrame, from the mocap process, to everyone
    <lab>/mocap/event, <lab>/mocap/state
    <lab>/mocap/alive/<configuration>   a liveliness token, for as long as a mocap process serves

Stamps are on the monotonic clock of the machine that published them: where that is another machine, its clock's name
is attached, and they are moved onto ours by the quickest frame received. The publisher's name is attached too: frames
of a second publisher are rejected while the first publishes.
"""

import asyncio
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import zenoh

from formation.messages import Event, LabFrame, RawFrame
from formation.model import LONGEST_NAME
from wire.clock import REAL_TIME, Clock
from wire.clock_offset import SenderClock
from wire.schema import Schema, SchemaError, schema_of
from wire.text import JsonError, parse_object, plain
from wire.transport.frame_check import lab_fault
from wire.transport.zenoh_bus import ZenohBus

SILENT_NS = 250_000_000
"""A publisher silent for so long may be replaced; less than the 0.4 s after which a lost body lands the swarm."""


@dataclass(slots=True)
class SourceFilter:
    """The publisher of one key. The bus does not authenticate publishers, but two at once are detected."""

    current: bytes | None = None
    _received_ns: int = 0

    def rejects(self, publisher: bytes, now_ns: int) -> bool:
        """Whether another publisher is current: its last frame is less than SILENT_NS old."""
        return self.current is not None and publisher != self.current and now_ns - self._received_ns < SILENT_NS

    def accept(self, publisher: bytes, now_ns: int) -> None:
        """Make this publisher the current one: its frame was valid."""
        self.current, self._received_ns = publisher, now_ns


T = TypeVar("T")

_RAW: Schema[RawFrame] = schema_of(RawFrame)
_FRAME: Schema[LabFrame] = schema_of(LabFrame)
_EVENT: Schema[Event] = schema_of(Event)
_ALIVE = "mocap/alive"
LONGEST_TEXT, MOST_CLOCKS = 500, 4


class MocapBus:
    """One process's view of it. Callbacks run on the event loop; the bus's `rejections` count rejected payloads."""

    def __init__(self, bus: ZenohBus, clock: Clock = REAL_TIME) -> None:
        self._bus = bus
        self._clock, self._clock_name = clock, clock.name()
        self._clocks: dict[bytes, SenderClock] = {}
        self._publisher = SourceFilter()

    def publish_raw(self, frame: RawFrame) -> None:
        """Publish one exposure as the cameras report it."""
        self._bus.publish("mocap/raw", _RAW.encode(frame))

    def on_raw(self, callback: Callable[[RawFrame], None]) -> None:
        """Call back with each raw frame, unchecked; the latest wins where the loop is late."""

        def receive(sample: zenoh.Sample) -> None:
            frame = self._decoded("mocap/raw", _RAW, sample)
            if frame is not None:
                callback(frame)

        self._bus.listen("mocap/raw", receive, limit=1)

    def publish_frame(self, frame: LabFrame) -> None:
        """Publish one exposure to everyone; the mocap process alone does."""
        self._bus.publish("mocap/frame", _FRAME.encode(frame), self._clock_name + b"\n" + self._bus.identity)

    @property
    def insecure(self) -> bool:
        """Whether this process was asked to open links to other machines without keys."""
        return self._bus.protection.bus.insecure

    @property
    def has_subscribers(self) -> bool:
        """Whether a process subscribes to the frames that this one publishes."""
        return self._bus.has_subscribers("mocap/frame")

    def on_frame(self, callback: Callable[[LabFrame], None], limit: int = 1) -> None:
        """Call back with each frame, its stamps on our clock; so many wait where the loop is late, the newest."""

        def receive(sample: zenoh.Sample) -> None:
            frame = self._decoded("mocap/frame", _FRAME, sample)
            if frame is None:
                return
            now_ns = self._clock.monotonic_ns()
            clock_name, publisher = _sender(sample.attachment)
            if self._publisher.rejects(publisher, now_ns):
                self._bus.reject("mocap/frame", f"frame of a second publisher, {_called(publisher)}")
                return
            frame = self._on_our_clock(frame, clock_name, now_ns)
            fault = lab_fault(frame, now_ns)
            if fault is None:
                self._publisher.accept(publisher, now_ns)
                callback(frame)
            else:
                self._bus.reject("mocap/frame", f"frame {fault}")

        self._bus.listen("mocap/frame", receive, limit)

    def publish_event(self, event: Event) -> None:
        """Publish an event of the mocap process."""
        self._bus.publish("mocap/event", _EVENT.encode(event))

    def on_event(self, callback: Callable[[Event], None]) -> None:
        """Call back with each event of the mocap process."""

        def receive(sample: zenoh.Sample) -> None:
            event = self._decoded("mocap/event", _EVENT, sample)
            if event is not None:
                source, text = plain(event.source, LONGEST_TEXT), plain(event.text, LONGEST_TEXT)
                code, subject = plain(event.code, LONGEST_TEXT), plain(event.subject, LONGEST_TEXT)
                callback(replace(event, source=source, text=text, code=code, subject=subject))

        self._bus.listen("mocap/event", receive, limit=64)

    def publish_state(self, state: dict[str, Any]) -> None:
        """Publish the state of the mocap process, as JSON."""
        self._bus.publish("mocap/state", json.dumps(state).encode())

    def on_state(self, callback: Callable[[dict[str, Any]], None]) -> None:
        """Call back with the state of the mocap process."""

        def receive(sample: zenoh.Sample) -> None:
            try:
                state = parse_object(sample.payload.to_bytes())
            except JsonError as error:
                self._bus.reject("mocap/state", str(error))
                return
            callback(state)

        self._bus.listen("mocap/state", receive, limit=1)

    def announce(self, configuration: str) -> None:
        """Declare that this process serves the lab's mocap with `configuration` (mocap.service), until it ends."""
        self._bus.declare_token(f"{_ALIVE}/{configuration}")

    async def serving(self, within_s: float) -> str | None:
        """The configuration that a mocap process serves; None where none was found in that time."""
        found: asyncio.Future[str] = asyncio.get_running_loop().create_future()

        def receive(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT and not found.done():
                found.set_result(str(sample.key_expr).rpartition("/")[2])

        close = self._bus.watch_tokens(f"{_ALIVE}/*", receive)
        try:
            return await asyncio.wait_for(found, within_s)
        except TimeoutError:
            return None
        finally:
            close()

    def _decoded(self, key: str, schema: Schema[T], sample: zenoh.Sample) -> T | None:
        try:
            return schema.decode(sample.payload.to_bytes())
        except SchemaError:
            self._bus.reject(key, f"no {schema.name}")
            return None

    def _on_our_clock(self, frame: LabFrame, name: bytes, now_ns: int) -> LabFrame:
        """The frame with its stamps on our clock; another machine's receive time counts as its publish time."""
        if not name or name == self._clock_name:
            return frame
        if name not in self._clocks:  # one mocap process serves a lab; forged names shall not grow without bound
            while len(self._clocks) >= MOST_CLOCKS:
                del self._clocks[next(iter(self._clocks))]
            self._clocks[name] = SenderClock()
        received_ns = self._clocks[name].made_ns(frame.t_receive_ns, now_ns)
        ahead_ns = received_ns - frame.t_receive_ns
        return replace(frame, t_capture_ns=frame.t_capture_ns + ahead_ns, t_receive_ns=received_ns)


def _sender(attachment: zenoh.ZBytes | None) -> tuple[bytes, bytes]:
    """The names of clock and publisher attached to a frame; empty where there are none."""
    data = b"" if attachment is None else attachment.to_bytes()[: 2 * LONGEST_NAME]
    name, _, publisher = data.partition(b"\n")
    return name[:LONGEST_NAME], publisher[:LONGEST_NAME]


def _called(publisher: bytes) -> str:
    """A publisher's name in few words."""
    return plain(publisher.decode(errors="replace"), 12) or "without a name"
