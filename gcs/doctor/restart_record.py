"""The doctor's record of what autopilots read as they boot and was not as wanted: a small file beside the lab file.

The ground reads it and refuses to arm a drone that has not booted since; whoever hears that boot, ground or doctor,
takes its entries out. The file holds dates, so it stays valid when the computer restarts. Parameters that others write
while neither doctor nor ground runs are not in it.
"""

import asyncio
import os
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

from pydantic import Field

from formation.messages import Event, Severity, UnmetParameter
from formation.model import Model
from gcs.drones.telemetry import NEVER_NS
from wire.clock import Clock
from wire.config_file import dump, load
from wire.errors import ConfigError
from wire.process.daemon import EventSink

BootTimes = Callable[[int], int | None]
"""When the autopilot of a drone's system id booted, on our clock; None where that is not known."""
POLL_NS = 1_000_000_000
MOST = 1000
"""Entries: 250 drones, each with a few."""


class Unmet(Model):
    """When a parameter of a drone was last written, or found not as wanted; a date, seconds since 1970."""

    sysid: Annotated[int, Field(ge=1, le=250)]
    parameter: Annotated[str, Field(pattern=r"^[A-Z0-9_]{1,16}$")]
    unix_s: Annotated[float, Field(ge=0.0, le=1e11)]


class _Record(Model):
    unmet: Annotated[tuple[Unmet, ...], Field(max_length=MOST)] = ()


def record_path(lab_file: Path) -> Path:
    """Where the record of a lab file is."""
    return lab_file.with_name(f"{lab_file.stem}-restarts.toml")


def read_record(lab_file: Path) -> tuple[Unmet, ...]:
    """The record beside the lab file, empty where there is no record; ConfigError."""
    path = record_path(lab_file)
    return load(path, _Record).unmet if path.exists() else ()


def note_unmet(lab_file: Path, sysid: int, parameter: str, unix_s: float) -> None:
    """Add one to the record, in the place of an older one of the same parameter; ConfigError, OSError."""
    others = [one for one in read_record(lab_file) if (one.sysid, one.parameter) != (sysid, parameter)]
    new = Unmet(sysid=sysid, parameter=parameter, unix_s=unix_s)
    _write(lab_file, (*others[-MOST + 1 :], new))


def drop_met(lab_file: Path, booted_ns: BootTimes, clock: Clock) -> tuple[Unmet, ...]:
    """Take out what drones have booted since, by the times of their last boots; what is left. ConfigError, OSError."""
    record = read_record(lab_file)
    left = tuple(one for one in record if (booted_ns(one.sysid) or NEVER_NS) <= unmet_ns(one, clock))
    if left != record:
        _write(lab_file, left)
    return left


def unmet_ns(unmet: Unmet, clock: Clock) -> int:
    """Its date on that clock."""
    return clock.at_unix_ns(round(unmet.unix_s * 1e9))


def _write(lab_file: Path, unmet: tuple[Unmet, ...]) -> None:
    path = record_path(lab_file)
    written = path.with_name(f".{path.name}.{os.getpid()}")
    written.write_text(dump(_Record(unmet=unmet)), encoding="utf-8")
    written.replace(path)


async def watch_record(
    lab_file: Path, deliver: Callable[[UnmetParameter], None], booted_ns: BootTimes, report: EventSink, clock: Clock
) -> None:
    """Deliver the record's entries, then new ones once a second, until cancelled; take out those that a boot has met.
    Report an unreadable record."""
    known, trouble = frozenset[Unmet](), ""
    while True:
        before = trouble
        try:
            found, trouble = frozenset(await asyncio.to_thread(drop_met, lab_file, booted_ns, clock)), ""
        except (ConfigError, OSError) as error:
            found, trouble = known, str(error)
        if trouble and trouble != before:
            report(Event(Severity.WARNING, "ground", f"which restarts are missing is not known: {trouble}"))
        for one in sorted(found - known, key=lambda one: (one.sysid, one.parameter)):
            deliver(UnmetParameter(one.sysid, one.parameter, unmet_ns(one, clock)))
        known = found
        await clock.sleep_until_ns(clock.monotonic_ns() + POLL_NS)
