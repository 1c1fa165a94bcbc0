"""Battery, link and mode of each drone as one small message, read from the drone's datagrams."""

from dataclasses import dataclass

from formation.messages import Datagram
from wire.link_messages.address import GROUND
from wire.link_messages.status import Battery, ExtendedSysState, Heartbeat, LandedState, NamedValue, SysStatus
from wire.mavlink.codec import Codec

READS = frozenset({0, 1, 147, 245, 251})
"""HEARTBEAT, SYS_STATUS, BATTERY_STATUS, EXTENDED_SYS_STATE, NAMED_VALUE_FLOAT; other messages are not decoded."""
_NAN = float("nan")


@dataclass(frozen=True, slots=True)
class DroneLink:
    """What a drone last said: pack voltage, V; charge, 0..1; what is not known is NaN.

    setpoint_age_ms: camera to drone; silent_s: since its last packet; received, lost: packets, by their numbers.
    landed: MAV_LANDED_STATE; custom_mode: its make's own number of its mode.
    """

    battery_v: float = _NAN
    battery: float = _NAN
    setpoint_age_ms: float = _NAN
    silent_s: float = _NAN
    received: int = 0
    lost: int = 0
    armed: bool = False
    landed: LandedState = LandedState.UNDEFINED
    custom_mode: int = 0


class LinkView:
    """The link state of one drone, from the datagrams that it sends."""

    def __init__(self, sysid: int) -> None:
        self._sysid = sysid
        self._codec = Codec(GROUND, reads=READS)
        self._battery_v = self._battery = self._age_ms = _NAN
        self._received = self._lost = 0
        self._seq: int | None = None
        self._received_ns: int | None = None
        self._armed, self._mode, self._landed = False, 0, LandedState.UNDEFINED

    def receive(self, datagram: Datagram, t_ns: int) -> None:
        """Receive a datagram of the drone."""
        for packet in self._codec.receive(datagram.data):
            if packet.source.system != self._sysid:
                continue
            self._received_ns = t_ns
            self._count(packet.seq)
            match packet.message:
                case Heartbeat() as heartbeat if packet.source.component == 1:
                    self._armed, self._mode = heartbeat.armed, heartbeat.custom_mode
                case SysStatus() as status:
                    self._battery_v, self._battery = status.battery_v, _share(status.battery_remaining)
                case Battery() as battery:
                    self._battery_v, self._battery = sum(battery.cell_v), _share(battery.remaining)
                case ExtendedSysState() as state:
                    self._landed = state.landed
                case NamedValue(name="age_ms") as age:
                    self._age_ms = age.value

    def now(self, t_ns: int) -> DroneLink:
        """The link state at `t_ns`."""
        silent_s = _NAN if self._received_ns is None else (t_ns - self._received_ns) * 1e-9
        return DroneLink(
            self._battery_v, self._battery, self._age_ms, silent_s, self._received, self._lost,
            self._armed, self._landed, self._mode,
        )  # fmt: skip

    def _count(self, seq: int) -> None:
        """A step of more than half the circle is a packet overtaken on the way: it was counted as lost."""
        step = 1 if self._seq is None else (seq - self._seq) % 256
        self._received += 1
        if step == 0 or step > 128:
            self._lost = max(self._lost - 1, 0)
        else:
            self._lost += step - 1
            self._seq = seq


def _share(remaining: float) -> float:
    return remaining if 0.0 <= remaining <= 1.0 else _NAN
