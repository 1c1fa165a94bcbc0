"""The protection of one process's links: nothing, its keys, or the operator's word that nothing has to.

A link that another machine reaches opens only with keys: it is asked here wherever a socket is bound or connected.
"""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from formation.exposure import GROUND, is_local_link, is_loopback
from formation.messages import Event, EventCode, Severity
from wire.errors import ConfigError
from wire.mavlink.signing import SigningChannel, StampClock
from wire.process.daemon import EventSink
from wire.security.bus_access import LOCAL, BusAccess, ExposedError, access_with
from wire.security.private_keys import (
    ACCESS,
    AUTOPILOT,
    INSTALLED,
    REVOKED_NAMES,
    STAMP,
    StampFile,
    drone_stamp_file,
    keys_folder,
    read_access,
    read_mavlink_key,
    read_mavlink_keys,
    read_revoked,
)

if TYPE_CHECKING:
    from formation.security_config import SecurityConfig

INSECURE = "--insecure: no link is authenticated, whoever reaches this network can command the drones"


@dataclass(frozen=True, slots=True)
class Signing:
    """The keys of MAVLink signing of one process, by system id, and its stamps."""

    keys: Mapping[int, bytes] = field(repr=False)
    clock: StampClock
    stamps: StampFile
    at_ground: bool
    _channels: dict[int, SigningChannel] = field(default_factory=dict, repr=False)

    def channel(self, sysid: int) -> SigningChannel | None:
        """This end of a drone's link, None without its key: the ground hears that system alone, a drone all others."""
        key = self.keys.get(sysid)
        if key is not None and sysid not in self._channels:
            is_peer: Callable[[int], bool] = sysid.__eq__ if self.at_ground else sysid.__ne__
            self._channels[sysid] = SigningChannel(
                key, self.clock, is_peer, trusts_clock=self.at_ground, begins_new_key=not self.at_ground
            )
        return self._channels.get(sysid)

    def refresh(self, keys: Mapping[int, bytes]) -> None:
        """The keys as their folder has them now: new ones are taken into use, those that are gone are revoked."""
        for sysid, channel in self._channels.items():
            channel.replace_key(keys.get(sysid))


class Names:
    """The names in the lab's certificates that its rules let in, and those revoked, as the folder of keys has them."""

    def __init__(self, own: Path) -> None:
        """Raises ConfigError."""
        self._own = own
        self._files = self._read_times()
        self.known, self.revoked = self._read(), read_revoked(own)

    def poll(self, signing: Signing | None) -> None:
        """Take over what has changed in the folder since the last look: names, and keys of signing. ConfigError."""
        files = self._read_times()
        if files != self._files:
            self.known, self.revoked = self._read(), read_revoked(self._own)
            if signing is not None:
                signing.refresh(read_mavlink_keys(self._own))
            self._files = files

    def _read_times(self) -> tuple[tuple[str, int], ...]:
        files = (*self._own.glob("mavlink-*.key"), self._own / ACCESS, *self._own.glob(REVOKED_NAMES))
        return tuple(sorted((file.name, file.stat().st_mtime_ns) for file in files))

    def _read(self) -> frozenset[str]:
        subjects = read_access(self._own).get("subjects", ())
        return frozenset(name for subject in subjects for name in subject.get("cert_common_names", ()))


@dataclass(frozen=True, slots=True)
class Protection:
    """How a process may open links: its access to the bus, the signing of its drones' MAVLink.

    autopilot: of a bridge, the signing between it and its autopilot. autopilot_has_key: whether the autopilot was given
    that key. names: of the certificates that are not revoked.
    """

    bus: BusAccess = LOCAL
    signing: Signing | None = None
    autopilot: Signing | None = None
    autopilot_has_key: bool = False
    names: "Names | None" = None

    @property
    def words(self) -> str:
        """For the record: who this process is on the bus, that it is on this machine alone, or that it is open."""
        if self.bus.insecure:
            return "insecure"
        return "loopback" if self.bus.identity is None else f"keys of {self.bus.name}"

    async def attend(self, report: EventSink) -> None:
        """Keep stamps on disk, use keys that change there, and report open links once a minute; until cancelled."""
        failed = False
        while self.names is not None or self.signing is not None:
            try:
                await asyncio.to_thread(self._attend_once)
            except (OSError, ConfigError) as error:
                if not failed:
                    report(Event(Severity.WARNING, "security", f"the folder of keys cannot be used: {error}"))
                failed = True
            await asyncio.sleep(StampFile.PERIOD_S)
        while self.bus.insecure:
            report(Event(Severity.WARNING, "security", INSECURE, lasts=True, code=EventCode.INSECURE))
            await asyncio.sleep(60.0)

    def _attend_once(self) -> None:
        """In a thread: a disk may answer late."""
        if self.signing is not None:
            self.signing.stamps.store(self.signing.clock.newest)
        if self.names is not None:
            self.names.poll(self.signing)

    def demand_host(self, what: str, host: str, sysid: int) -> None:
        """ExposedError for a host of MAVLink that is not this machine, without a key of that drone."""
        if not (self.channel(sysid) is not None or self.bus.insecure or is_loopback(host)):
            raise ExposedError(what, host)

    def towards_autopilot(self, link: str) -> "Protection":
        """The protection of a bridge's link to its autopilot: a key where it has one, and always over a network."""
        signed = self.autopilot_has_key or not is_local_link(link)
        return replace(self, signing=self.autopilot if signed else None)

    def channel(self, sysid: int) -> SigningChannel | None:
        """The signing of a drone's link; None where it is not signed."""
        return None if self.signing is None else self.signing.channel(sysid)


LOOPBACK_ONLY = Protection()


def protection_of(keys: Path, identity: str) -> Protection:
    """The protection by an identity's keys in a folder. ConfigError for keys that are missing or open to others."""
    access, own = access_with(keys, identity), keys / identity
    mavlink_keys = read_mavlink_keys(own)
    if not mavlink_keys:
        return Protection(access, names=Names(own))
    stamps = StampFile(own / (STAMP if identity == GROUND else drone_stamp_file(mavlink_keys)))
    stamp_clock = StampClock(stamps.read())
    signing = Signing(mavlink_keys, stamp_clock, stamps, identity == GROUND)
    has_key = (own / INSTALLED).is_file()
    inner = own / (INSTALLED if has_key else AUTOPILOT)
    autopilot = None
    if inner.is_file() and len(signing.keys) == 1:
        autopilot = Signing({sysid: read_mavlink_key(inner) for sysid in signing.keys}, stamp_clock, stamps, True)
    return Protection(access, signing, autopilot, has_key, Names(own))


def lab_protection(
    security: "SecurityConfig | None", lab_file: Path, identity: str, *, insecure: bool = False
) -> Protection:
    """The protection of a program of the lab in `lab_file`, which is `identity`. ConfigError."""
    if security is not None:
        return protection_of(keys_folder(security.keys, lab_file), identity)
    return Protection(BusAccess(insecure=insecure)) if insecure else LOOPBACK_ONLY
