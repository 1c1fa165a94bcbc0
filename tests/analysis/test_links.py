"""How old telemetry was as it was read, out of a log: by the drone's clock, whatever that says."""

from dataclasses import fields

import numpy as np
import pytest

from analysis.links import STEP_NS, backlogs, histories
from analysis.load import Flight, from_records
from analysis.metrics import summarise
from analysis.report import html
from formation import topics
from formation.messages import Datagram
from tests.analysis.synthetic_flight import METADATA, Record, t_ns
from wire.link_messages import (
    GROUND,
    Address,
    AttitudeQuaternion,
    Battery,
    ExtendedSysState,
    Heartbeat,
    LandedState,
    LocalPosition,
    MavAutopilot,
    NamedValue,
    SysStatus,
    TimeSync,
)
from wire.logs.views import DroneLink, LinkView
from wire.mavlink.codec import Codec
from wire.mavlink.framing import CRC_EXTRA, sealed

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


def link_states(datagrams: list[tuple[int, Datagram]]) -> dict[int, list[tuple[int, DroneLink]]]:
    """Every drone's at each tenth of a second, datagram by datagram."""
    views: dict[int, LinkView] = {}
    rows: dict[int, list[tuple[int, DroneLink]]] = {}
    next_ns = datagrams[0][0] + STEP_NS
    for now_ns, datagram in datagrams:
        while now_ns >= next_ns:
            for sysid, view in views.items():
                rows[sysid].append((next_ns, view.now(next_ns)))
            next_ns += STEP_NS
        if datagram.sysid not in views:
            views[datagram.sysid], rows[datagram.sysid] = LinkView(datagram.sysid), []
        views[datagram.sysid].receive(datagram, now_ns)
    for sysid, view in views.items():
        rows[sysid].append((now_ns, view.now(now_ns)))
    return rows


@pytest.mark.parametrize("seed", range(4))
def test_the_history_of_a_link_is_what_its_view_says_packet_by_packet(seed: int):
    """Drones that begin one after the other; packets that are lost, doubled, overtaken, of others, and unreadable."""
    rng = np.random.default_rng(seed)
    codecs = {sysid: Codec(Address(sysid, 1)) for sysid in (1, 2, 3)}
    sent: list[tuple[int, Datagram]] = []
    for k in range(400):
        sysid = int(rng.integers(1, 2 + min(k // 50, 2)))
        level = float(rng.uniform(0.0, 1.2))
        packets = [
            codecs[sysid].encode(message)
            for message in (
                Heartbeat(MavAutopilot.PX4, 2, int(rng.integers(0, 256)), k, 4),
                SysStatus(0, 0, 0, 0.0, 12.0 + level, 1.0, level),
                Battery((3.7, 3.0 + level), 1.0, 10.0, level),
                ExtendedSysState(LandedState(int(rng.integers(0, 5)))),
                NamedValue(k, "age_ms", level),
                NamedValue(k, "age", level),
                AttitudeQuaternion(k, np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3)),
            )
        ]
        kept = [packet for packet in rng.permutation(np.array(packets, dtype=object)) if rng.random() < 0.7]
        if k % 30 == 7:
            kept += [b"noise", codecs[1 + sysid % 3].encode(NamedValue(k, "age_ms", 99.0)), kept[0]]
        odd = Heartbeat(MavAutopilot.PX4, 2, 0, 0, 4)
        if k % 40 == 9:  # of an autopilot that is none of ours
            framed = bytearray(codecs[sysid].encode(odd))
            framed[10 + 5] = 250
            kept.append(sealed(bytes(framed[:-2]), CRC_EXTRA[0]))
        sent.append((int(k * 13_000_000), Datagram(sysid, b"".join(kept)[:2000])))
    flight = from_records({}, [Record(topics.LINK_UP, 10**9 + now_ns, datagram) for now_ns, datagram in sent])
    found = histories(flight.up)
    wanted = link_states(sent)
    assert list(found) == sorted(wanted)
    for sysid, history in found.items():
        assert history["t_ns"].tolist() == [now_ns for now_ns, _ in wanted[sysid]]
        for name in (field.name for field in fields(DroneLink)):
            np.testing.assert_array_equal(history[name], [getattr(state, name) for _, state in wanted[sysid]], name)
