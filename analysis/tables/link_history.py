"""What each drone said of itself through a flight, ten times a second: battery, link, mode. Out of its datagrams."""

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formation.messages import Datagram
from wire.logs.drone_link import DroneLink, LinkView

STEP_NS = 100_000_000
History = Mapping[str, NDArray[Any]]
"""`t_ns` and every field of `DroneLink`, each (T,)."""


def histories(said: Iterable[tuple[int, Datagram]]) -> dict[int, History]:
    """(t_ns, datagram) in order -> by sysid, what was last known at each tenth of a second since it was first heard.

    And at the time of the last datagram.
    """
    views: dict[int, LinkView] = {}
    rows: dict[int, list[tuple[int, DroneLink]]] = {}
    next_ns: int | None = None
    t_ns = 0
    for t_ns, datagram in said:
        next_ns = t_ns + STEP_NS if next_ns is None else next_ns
        while t_ns >= next_ns:
            for sysid, view in views.items():
                rows[sysid].append((next_ns, view.now(next_ns)))
            next_ns += STEP_NS
        if datagram.sysid not in views:
            views[datagram.sysid], rows[datagram.sysid] = LinkView(datagram.sysid), []
        views[datagram.sysid].take(datagram, t_ns)
    for sysid, view in views.items():
        rows[sysid].append((t_ns, view.now(t_ns)))
    return {sysid: _columns(told) for sysid, told in sorted(rows.items())}


def _columns(told: list[tuple[int, DroneLink]]) -> History:
    columns: dict[str, NDArray[Any]] = {"t_ns": np.array([t_ns for t_ns, _ in told], np.int64)}
    for field in fields(DroneLink):
        columns[field.name] = np.array([getattr(link, field.name) for _, link in told])
    return columns
