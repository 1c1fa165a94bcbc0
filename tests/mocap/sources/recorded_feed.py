"""A source's way in, with what came kept; the time is what the test says, or a clock that it gives."""

from dataclasses import dataclass, field
from typing import Any

from formation.messages import Event, RawFrame
from formation.mocap_config import MocapConfig
from mocap.sources.source import Feed
from wire.clock import Clock
from wire.rejections import RejectionLog


@dataclass
class Kept:
    """What a source delivered and when, what it said and refused."""

    config: MocapConfig
    clock: Clock | None = None
    now_ns: int = 10**12
    frames: list[RawFrame] = field(default_factory=list)
    came_ns: list[int] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    refusals: RejectionLog = field(default_factory=RejectionLog)

    def monotonic_ns(self) -> int:
        return self.now_ns

    def feed(self) -> Feed:
        def deliver(frame: RawFrame) -> None:
            self.frames.append(frame)
            self.came_ns.append(self.now_ns)

        return Feed(self.config, deliver, self.events.append, self.refusals, self.clock or self)

    def texts(self) -> list[str]:
        return [event.text for event in self.events]

    def refused(self) -> list[str]:
        """What was refused and not looked at yet, in words."""
        return [event.text for event in self.refusals.due(10**18)]


def kept(source: str, **mocap: Any) -> Kept:
    return Kept(MocapConfig.model_validate({"source": source, **mocap}))
