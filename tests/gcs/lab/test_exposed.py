"""No lab file opens a link to another machine without keys: by `gcs check`, and by what is asked before one opens."""

from itertools import count

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from formation.config import LabConfig
from formation.exposure import is_local_endpoint
from gcs.lab.judge import SECURITY, judge
from wire.security.bus_access import BusAccess, ExposedError
from wire.security.protection import LOOPBACK_ONLY, Protection

HERE = st.sampled_from(["127.0.0.1", "127.0.0.2", "localhost"])
ELSEWHERE = st.one_of(
    st.sampled_from(["0.0.0.0", "localhost.evil", "127.0.0.1.evil", "evil-127.0.0.1", "a127.0.0.1", "lab-pc"]),
    st.ip_addresses(v=4).filter(lambda address: not address.is_loopback).map(str),
)
BUS_HERE = st.one_of(HERE, st.just("[::1]"))
BUS_ELSEWHERE = st.one_of(ELSEWHERE, st.sampled_from(["[::]", "[fe80::1]", "[2001:db8::1]"]))


@st.composite
def labs(draw: st.DrawFn) -> tuple[dict[str, object], bool]:
    """A lab's values, and whether one of its links is another machine's: by how it was made, not by how it is read."""
    exposed = False

    def host(here: st.SearchStrategy[str], elsewhere: st.SearchStrategy[str]) -> str:
        nonlocal exposed
        away = draw(st.booleans()) and draw(st.booleans())
        exposed |= away
        return draw(elsewhere if away else here)

    def endpoints(low: int) -> list[str]:
        protocol = draw(st.sampled_from(["tcp", "tls", "udp", "quic", "ws"]))
        return [f"{protocol}/{host(BUS_HERE, BUS_ELSEWHERE)}:{7447 + k}" for k in range(draw(st.integers(low, 2)))]

    link: dict[str, object] = {"zenoh_listen": endpoints(0), "zenoh_connect": endpoints(0)}
    if draw(st.booleans()):
        link |= {"kind": "udp", "host": host(HERE, ELSEWHERE)}
    ports = count(15000)
    bodies = [{"body": "lead", "sysid": 1}, {"body": "left", "sysid": 2, "offset_m": [-0.5, 0.5, 0.0]}]
    for body in bodies:
        if draw(st.booleans()):
            kind = draw(st.sampled_from(["udp", "udpin", "udpout"]))
            body |= {"link": f"{kind}:{host(HERE, ELSEWHERE)}:{next(ports)}", "profile": "x500", "guard": "none"}
    return {"leader": bodies[0], "followers": bodies[1:], "link": link}, exposed


@settings(max_examples=1000, deadline=None)
@given(labs())
def test_a_lab_is_refused_exactly_where_another_machine_reaches_a_link(drawn: tuple[dict[str, object], bool]) -> None:
    values, exposed = drawn
    lab = LabConfig.model_validate(values)
    assert any(found.check == SECURITY for found in judge(lab)) is exposed
    assert opens(lab, LOOPBACK_ONLY) is not exposed
    assert opens(lab, Protection(BusAccess(insecure=True)))
    if not exposed:
        assert is_local_endpoint(BusAccess().own_endpoint(lab.link.zenoh_connect))


def opens(lab: LabConfig, protection: Protection) -> bool:
    """Whether every socket of the lab may be opened; asked where each is opened, without opening it."""
    try:
        protection.bus.demand((*lab.link.zenoh_listen, *lab.link.zenoh_connect))
        if lab.link.kind == "udp":
            protection.demand_host("link.host", lab.link.host, 1)
        for vehicle in lab.vehicles:
            if vehicle.link is not None:
                protection.demand_host("link", vehicle.link.split(":")[1], vehicle.sysid or 0)
    except ExposedError:
        return False
    return True


LAB = {
    "leader": {"body": "lead", "sysid": 1},
    "followers": [{"body": "left", "sysid": 2, "offset_m": [-0.5, 0.5, 0.0]}],
}


@pytest.mark.parametrize(
    ("listen", "addresses", "subject"),
    [
        ("tcp/192.0.2.1:7447", (), None),
        ("udp/192.0.2.1:7447", (), "link.zenoh_listen[0]"),
        ("tls/0.0.0.0:7447", (), "link.zenoh_listen[0]"),
        ("tls/0.0.0.0:7447", ("192.0.2.1",), None),
    ],
)
def test_keys_open_links_and_only_tls_carries_the_bus(listen: str, addresses: tuple[str, ...], subject) -> None:
    link = {"zenoh_listen": [listen], "zenoh_connect": []}
    config = LabConfig.model_validate(LAB | {"link": link, "security": {"addresses": addresses}})
    found = [f for f in judge(config) if f.check == SECURITY]
    assert [f.subject for f in found] == ([] if subject is None else [subject])
    assert all(f.wanted == "security.addresses = [...]" for f in found if listen.startswith("tls"))
