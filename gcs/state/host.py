"""The host's part of the published state: the machine's control cycles, the log and its disk, the newest events."""

import os
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from formation.messages import Event, Severity
from gcs.state.alarms import AlarmBook

EVENTS_MAX = 40
"""Events that are kept for viewers that connect later."""


@dataclass(frozen=True, slots=True)
class Disk:
    """Size of the log and free space on its disk, bytes; None while unknown."""

    log_bytes: int | None = None
    free_bytes: int | None = None


def disk(log: Path) -> Disk:
    """As the file system says now; it may take its time."""
    try:
        usage = os.statvfs(log)
        return Disk(log.stat().st_size, usage.f_bavail * usage.f_frsize)
    except OSError:  # the log's own trouble says more, and is an alarm
        return Disk()


class EventMemory:
    """The alarms, and the newest events: numbered from 1 on, with their wall-clock times, debugging words left out."""

    def __init__(self) -> None:
        self._count = 0
        self._events: deque[dict[str, Any]] = deque(maxlen=EVENTS_MAX)
        self.alarms = AlarmBook()

    def note(self, event: Event, unix_us: int) -> None:
        """Keep it."""
        if event.severity is Severity.DEBUG:
            return
        self.alarms.receive(event, round(unix_us * 1e-6, 2))
        self._count += 1
        self._events.append(
            {
                "id": self._count,
                "unix_s": round(unix_us * 1e-6, 2),
                "severity": event.severity.name,
                "source": event.source,
                "text": event.text,
            }
        )

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return iter(self._events)


def host_state(
    cycles: int, late: int, worst_s: float, log: Path, usage: Disk, events: EventMemory
) -> dict[str, Any]:  # fmt: skip
    """What the published state says beside the swarm's part, as JSON has it."""
    return {
        "cycles": {"count": cycles, "late": late, "worst_ms": round(worst_s * 1e3, 2)},
        "log": {"name": log.name, "bytes": usage.log_bytes, "free_bytes": usage.free_bytes},
        "events": list(events),
        "alarms": [alarm.as_json() for alarm in events.alarms.open],
    }
