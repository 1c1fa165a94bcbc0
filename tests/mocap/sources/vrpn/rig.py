"""A lab, a source of it, and all that comes out of that."""

from dataclasses import dataclass, field
from typing import Any

from formation.config import LabConfig
from formation.messages import Event, RawFrame
from mocap.sources.source import Feed
from mocap.sources.vrpn.client import VrpnSource, chingmu_source, vrpn_source
from mocap.sources.vrpn.session import VrpnSession
from wire.clock import REAL_TIME
from wire.rejections import RejectionLog

MAKES = {"vrpn": vrpn_source, "chingmu": chingmu_source}


def lab_of(source: str, server: dict[str, Any] | None = None, **mocap: Any) -> LabConfig:
    """Three bodies: leader, left, right."""
    return LabConfig.model_validate(
        {
            "leader": {"body": "leader"},
            "followers": [
                {"body": body, "sysid": sysid, "offset_m": (-1.0, y, 0.0)}
                for body, sysid, y in (("left", 2, 1.0), ("right", 3, -1.0))
            ],
            "mocap": {"source": source, source: server or {}, **mocap},
        }
    )


@dataclass(slots=True)
class Rig:
    """One source between a lab and lists."""

    config: LabConfig
    frames: list[RawFrame] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    refusals: RejectionLog = field(default_factory=RejectionLog)

    @property
    def source(self) -> VrpnSource:
        """A new source whose frames and words come here."""
        feed = Feed(self.config.mocap, self.frames.append, self.events.append, self.refusals, REAL_TIME)
        return MAKES[self.config.mocap.source](self.config, feed)

    def session(self, now_ns: int) -> VrpnSession:
        """A connection of a source, without its sockets."""
        session, _ = self.source.open(now_ns, "127.0.0.1", "127.0.0.1")
        return session.vrpn  # type: ignore[attr-defined]

    def texts(self) -> list[str]:
        """What the operator was told."""
        return [event.text for event in self.events]

    def refused(self, now_ns: int) -> str:
        """What was refused, in words."""
        return " ".join(event.text for event in self.refusals.due(now_ns + 2_000_000_000))
