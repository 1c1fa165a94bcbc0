"""Kinds of VRPN servers: how each maps bodies to senders and sensors, and how often it sends a pose. Pure."""

from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from formation.maths.arrays import Quat, Vec3
from formation.messages import RawFrame

STAMP_STEP_NS = 10_000
"""Step between the stamps of successive trackers' poses in one exposure."""


class Report(NamedTuple):
    """One pose message: its sender, sensor, position in the server's unit, quaternion w x y z, stamp on top."""

    sender: str
    sensor: int
    pos: Vec3
    q: Quat
    later_ns: int


class ServerKind(Protocol):
    """One kind of VRPN server."""

    def senders(self, bodies: tuple[str, ...]) -> tuple[str, ...]:
        """The names of its senders, for these bodies of the lab."""

    def reports(self, frame: RawFrame) -> list[Report]:
        """The reports of one exposure, in the order of sending."""


@dataclass(frozen=True, slots=True)
class TrackerEach:
    """A tracker a body, sensor 0; of a body out of sight comes nothing."""

    unit_m: float

    def senders(self, bodies: tuple[str, ...]) -> tuple[str, ...]:
        """Their own names."""
        return bodies

    def reports(self, frame: RawFrame) -> list[Report]:
        """One a body in sight."""
        senders, pos = self.senders(frame.bodies), frame.pos_mocap_m / self.unit_m
        return [
            Report(senders[i], 0, pos[i], frame.q_mocap_from_marker[i], k * STAMP_STEP_NS)
            for k, i in enumerate(np.flatnonzero(frame.seen).tolist())
        ]


@dataclass(slots=True)
class SensorEach:
    """Chingmu: one device, a sensor a body; each pose is sent twice, and that of a lost body again and again."""

    unit_m: float
    device: str
    first_sensor: int
    names: dict[str, str]
    """Bodies to the numbers of their sensors, where they are not the next free ones."""
    _numbers: dict[str, int] = field(default_factory=dict)
    _shown: dict[str, tuple[Vec3, Quat]] = field(default_factory=dict)

    def senders(self, bodies: tuple[str, ...]) -> tuple[str, ...]:
        """The device."""
        for body in bodies:
            self._number(body)
        return (self.device,)

    def reports(self, frame: RawFrame) -> list[Report]:
        """Two a body that was ever in sight."""
        pos = frame.pos_mocap_m / self.unit_m
        for i in np.flatnonzero(frame.seen).tolist():
            self._shown[frame.bodies[i]] = pos[i].copy(), frame.q_mocap_from_marker[i].copy()
        reports = []
        for body in frame.bodies:
            if body in self._shown:
                reports += 2 * [Report(self.device, self._number(body), *self._shown[body], 0)]
        return reports

    def _number(self, body: str) -> int:
        number = self._numbers.get(body)
        if number is None:
            named, number = self.names.get(body), self.first_sensor
            used = {str(other) for other in self._numbers.values()}.union(self.names.values())
            while str(number) in used:
                number += 1
            number = self._numbers[body] = number if named is None else int(named)
        return number
