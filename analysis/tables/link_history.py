"""What each drone said of itself through a flight, ten times a second: battery, link, mode. Out of its datagrams."""

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formation.messages import Datagram
from wire.logs.views import DroneLink, LinkView

STEP_NS = 100_000_000
History = Mapping[str, NDArray[Any]]
"""`t_ns` and every field of `DroneLink`, each (T,)."""


def histories(datagrams: Iterable[tuple[int, Datagram]]) -> dict[int, History]:
    """The link state of each drone, by sysid, at each tenth of a second from its first datagram to the last of all.

    datagrams: (t_ns, datagram) in the order of time.
    """
    views: dict[int, LinkView] = {}
    rows: dict[int, list[tuple[int, DroneLink]]] = {}
    next_ns: int | None = None
    t_ns = 0
    for t_ns, datagram in datagrams:
        next_ns = t_ns + STEP_NS if next_ns is None else next_ns
        while t_ns >= next_ns:
            for sysid, view in views.items():
                rows[sysid].append((next_ns, view.now(next_ns)))
            next_ns += STEP_NS
        if datagram.sysid not in views:
            views[datagram.sysid], rows[datagram.sysid] = LinkView(datagram.sysid), []
        views[datagram.sysid].receive(datagram, t_ns)
    for sysid, view in views.items():
        rows[sysid].append((t_ns, view.now(t_ns)))
    return {sysid: _columns(states) for sysid, states in sorted(rows.items())}


def _columns(states: list[tuple[int, DroneLink]]) -> History:
    columns: dict[str, NDArray[Any]] = {"t_ns": np.array([t_ns for t_ns, _ in states], np.int64)}
    for field in fields(DroneLink):
        columns[field.name] = np.array([getattr(link, field.name) for _, link in states])
    return columns
