"""A lab, a source of it, and all that comes out of that."""

from typing import Any

from formation.config import LabConfig
from mocap.sources.vrpn.session import VrpnSession, VrpnSource, chingmu_source, vrpn_source
from tests.mocap.sources.recorded_feed import Kept
from wire.clock import REAL_TIME

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


class Rig(Kept):
    """One source between a lab and lists."""

    def __init__(self, lab: LabConfig) -> None:
        super().__init__(lab.mocap, REAL_TIME)
        self._lab = lab

    @property
    def source(self) -> VrpnSource:
        """A new source whose frames and words come here."""
        return MAKES[self.config.source](self._lab, self.feed())

    def session(self, now_ns: int) -> VrpnSession:
        """A connection of a source, without its sockets."""
        session, _ = self.source.open(now_ns, "127.0.0.1", "127.0.0.1")
        return session.vrpn  # type: ignore[attr-defined]
