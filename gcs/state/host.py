"""The host's part of the published state: the machine's control cycles, the log and its disk, what was told of late."""

import os
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from formation.messages import Event, Severity

KEPT = 40
"""Events that whoever looks on later is still told of."""


@dataclass(frozen=True, slots=True)
class Disk:
    """Size of the log and room left beside it, bytes; None where the disk has not said."""

    log_bytes: int | None = None
    free_bytes: int | None = None


def disk(log: Path) -> Disk:
    """As the file system says now; it may take its time."""
    try:
        room = os.statvfs(log)
        return Disk(log.stat().st_size, room.f_bavail * room.f_frsize)
    except OSError:  # the log's own trouble says more, and is an alarm
        return Disk()


class EventMemory:
    """The newest events, numbered from 1 on, each with its wall-clock time; debugging words are left out."""

    def __init__(self) -> None:
        self._count = 0
        self._kept: deque[dict[str, Any]] = deque(maxlen=KEPT)

    def note(self, event: Event, unix_us: int) -> None:
        """Keep it."""
        if event.severity is Severity.DEBUG:
            return
        self._count += 1
        self._kept.append(
            {
                "id": self._count,
                "unix_s": round(unix_us * 1e-6, 2),
                "severity": event.severity.name,
                "source": event.source,
                "text": event.text,
            }
        )

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return iter(self._kept)


def host_state(
    cycles: int, late: int, worst_s: float, log: Path, room: Disk, told: EventMemory
) -> dict[str, Any]:  # fmt: skip
    """What the published state says beside the swarm's part, as JSON has it."""
    return {
        "cycles": {"count": cycles, "late": late, "worst_ms": round(worst_s * 1e3, 2)},
        "log": {"name": log.name, "bytes": room.log_bytes, "free_bytes": room.free_bytes},
        "events": list(told),
    }
