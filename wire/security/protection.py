"""What protects the links of one process: nothing, its keys, or the operator's word that nothing has to.

A link that another machine reaches opens only with keys: it is asked here wherever a socket is bound or connected.
"""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from formation.exposure import is_loopback
from formation.identities import GROUND
from formation.messages import Event, Severity
from formation.security_config import SecurityConfig
from wire.mavlink.signing import SigningChannel, StampClock
from wire.process.lifetime import EventSink
from wire.security.bus_access import LOCAL, BusAccess, ExposedError, access_with
from wire.security.private_keys import (
    AUTOPILOT,
    STAMP,
    StampFile,
    keys_folder,
    read_mavlink_key,
    read_mavlink_keys,
)

INSECURE = "--insecure: no link is authenticated, whoever reaches this network can command the drones"
REMIND_S = 60.0


@dataclass(frozen=True, slots=True)
class Signing:
    """The keys of MAVLink signing of one process, by system id, and its stamps."""

    keys: Mapping[int, bytes] = field(repr=False)
    clock: StampClock
    stamps: StampFile
    at_ground: bool

    def channel(self, sysid: int) -> SigningChannel | None:
        """This end of a drone's link, None without its key: the ground hears that system alone, a drone all others."""
        key = self.keys.get(sysid)
        if key is None:
            return None
        is_peer: Callable[[int], bool] = sysid.__eq__ if self.at_ground else sysid.__ne__
        return SigningChannel(key, self.clock, is_peer, trusts_clock=self.at_ground)

    async def store_stamps(self, report: EventSink) -> None:
        """Keep the newest stamp on disk, and report once where that fails; runs until cancelled."""
        failed = False
        while True:
            try:
                await asyncio.to_thread(self.stamps.store, self.clock.newest)
            except OSError as error:
                if not failed:
                    text = f"stamps of signed packets are not kept, replays pass after a restart: {error.strerror}"
                    report(Event(Severity.WARNING, "security", text))
                failed = True
            await asyncio.sleep(StampFile.PERIOD_S)


@dataclass(frozen=True, slots=True)
class Protection:
    """How a process may open links: its access to the bus, the signing of its drones' MAVLink.

    autopilot: of a bridge, the signing between it and an autopilot that is reached by a network.
    """

    bus: BusAccess = LOCAL
    signing: Signing | None = None
    autopilot: Signing | None = None

    @property
    def words(self) -> str:
        """For the record: who this process is on the bus, that it is on this machine alone, or that it is open."""
        if self.bus.insecure:
            return "insecure"
        return "loopback" if self.bus.identity is None else f"keys of {self.bus.name}"

    async def attend(self, report: EventSink) -> None:
        """Keep the stamps of signed packets on disk, and report open links once a minute; runs until cancelled."""
        if self.signing is not None:
            await self.signing.store_stamps(report)
        while self.bus.insecure:
            report(Event(Severity.WARNING, "security", INSECURE))
            await asyncio.sleep(REMIND_S)

    def demand_host(self, what: str, host: str, sysid: int) -> None:
        """ExposedError for a host of MAVLink that is not this machine, without a key of that drone."""
        if not (self.channel(sysid) is not None or self.bus.insecure or is_loopback(host)):
            raise ExposedError(what, host)

    def channel(self, sysid: int) -> SigningChannel | None:
        """The signing of a drone's link; None where it is not signed."""
        return None if self.signing is None else self.signing.channel(sysid)


LOOPBACK_ONLY = Protection()


def protection_of(keys: Path, identity: str) -> Protection:
    """What the keys of an identity in a folder protect. ConfigError for keys that are missing or open to others."""
    access, own = access_with(keys, identity), keys / identity
    mavlink_keys = read_mavlink_keys(own)
    if not mavlink_keys:
        return Protection(access)
    stamps = StampFile(own / STAMP)
    stamp_clock = StampClock(stamps.read())
    signing = Signing(mavlink_keys, stamp_clock, stamps, identity == GROUND)
    inner = own / AUTOPILOT
    autopilot = None
    if inner.is_file() and len(signing.keys) == 1:
        autopilot = Signing({sysid: read_mavlink_key(inner) for sysid in signing.keys}, stamp_clock, stamps, True)
    return Protection(access, signing, autopilot)


def lab_protection(
    security: SecurityConfig | None, lab_file: Path, identity: str, *, insecure: bool = False
) -> Protection:
    """What protects a program of the lab in `lab_file`, as which it is `identity`. ConfigError."""
    if security is not None:
        return protection_of(keys_folder(security.keys, lab_file), identity)
    return Protection(BusAccess(insecure=insecure)) if insecure else LOOPBACK_ONLY
