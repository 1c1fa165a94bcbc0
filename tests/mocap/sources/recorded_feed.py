"""A source's way in, with what came kept; the time is what the test says."""

from dataclasses import dataclass, field
from typing import Any

from formation.messages import Event, RawFrame
from formation.mocap_config import MocapConfig
from mocap.sources.source import Feed
from wire.clock import REAL_TIME, Clock
from wire.rejections import RejectionLog


@dataclass(slots=True)
class Kept:
    """What a source delivered, said and refused."""

    config: MocapConfig
    clock: Clock = REAL_TIME
    frames: list[RawFrame] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    refusals: RejectionLog = field(default_factory=RejectionLog)

    def feed(self) -> Feed:
        return Feed(self.config, self.frames.append, self.events.append, self.refusals, self.clock)

    def texts(self) -> list[str]:
        return [event.text for event in self.events]

    def refused(self) -> list[str]:
        """What was refused and not looked at yet, in words."""
        return [event.text for event in self.refusals.due(10**18)]


def kept(source: str, **mocap: Any) -> Kept:
    return Kept(MocapConfig.model_validate({"source": source, **mocap}))
