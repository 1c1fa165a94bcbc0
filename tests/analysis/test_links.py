"""How old telemetry was as it was read, out of a log: by the drone's clock, whatever that says."""

import numpy as np
import pytest

from analysis.links import backlogs
from analysis.load import Flight, from_records
from analysis.metrics import summarise
from analysis.report import html
from formation import topics
from formation.messages import Datagram
from tests.analysis.synthetic_flight import METADATA, Record, t_ns
from wire.link_messages import GROUND, Address, LocalPosition, TimeSync
from wire.mavlink.codec import Codec

AHEAD_NS = 77_000_000_000
LEFT = Address(2, 1)


def flown(late_ms: int, superseded: int = 0) -> Flight:
    """The drone's clock is 77 s ahead; it is asked for it at 1 s, and tells its place 30 times a second."""
    ground, drone = Codec(GROUND), Codec(LEFT)
    asked_ns = t_ns(1.0)
    told = [
        Record(topics.LINK_DOWN, asked_ns, Datagram(2, ground.encode(TimeSync(0, asked_ns, LEFT)))),
        Record(
            topics.LINK_UP,
            asked_ns + 2_000_000,
            Datagram(2, drone.encode(TimeSync(asked_ns + 1_000_000 + AHEAD_NS, asked_ns, GROUND))),
        ),
    ]
    for k in range(300):
        made_ns = t_ns(1.1 + k / 30)
        where = LocalPosition((made_ns + AHEAD_NS) // 1_000_000, np.zeros(3), np.zeros(3))
        waits_ns = (late_ms if k % 50 == 0 else 3) * 1_000_000
        datagram = Datagram(2, drone.encode(where), superseded if k == 7 else 0)
        told.append(Record(topics.LINK_UP, made_ns + waits_ns, datagram))
    return from_records(METADATA, sorted(told, key=lambda record: record.t_ns))


def test_the_backlog_is_the_age_by_the_drones_own_clock_and_is_reported():
    flight = flown(late_ms=640, superseded=12)
    (link,) = backlogs(flight)
    assert (link.sysid, link.superseded, len(link.behind_ms)) == (2, 12, 300)
    assert abs(np.median(link.behind_ms) - 3.0) < 1.1
    assert abs(link.behind_ms.max() - 640.0) < 1.1
    summary = summarise(flight)
    assert summary.link_behind_ms is not None
    assert summary.link_behind_ms.max == pytest.approx(link.behind_ms.max())
    page = html(flight, summary)
    assert "packets superseded" in page
    assert '<td class="number">12</td>' in page
    assert backlogs(from_records(METADATA, [])) == ()
