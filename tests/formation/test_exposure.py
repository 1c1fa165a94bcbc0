"""What counts as this machine: RFC 1122 (127/8), RFC 4291 (::1) and the name localhost (RFC 6761), nothing else."""

import pytest

from formation.exposure import endpoint_host, is_local_endpoint, is_local_link, is_loopback


@pytest.mark.parametrize("host", ["127.0.0.1", "127.255.255.254", "::1", "localhost", "LOCALHOST"])
def test_this_machine(host: str) -> None:
    assert is_loopback(host)


@pytest.mark.parametrize(
    "host",
    [
        "0.0.0.0", "::", "192.168.1.20", "10.0.0.1", "128.0.0.1", "126.255.255.255", "fe80::1", "224.0.0.1", "",
        "localhost.evil", "127.0.0.1.evil.org", "evil-localhost", "127.1", "0127.0.0.1", "2130706433", "0x7f000001",
        "127.0.0.1 ", "127.0.0.1/8", "lab-pc", "localhost.",
    ],
)  # fmt: skip
def test_another_machine(host: str) -> None:
    assert not is_loopback(host)


@pytest.mark.parametrize(
    "endpoint", ["tcp/127.0.0.1:7447", "tls/[::1]:1", "tcp/localhost:0#iface=lo", "unixsock-stream//tmp/bus"]
)
def test_local_endpoint(endpoint: str) -> None:
    assert is_local_endpoint(endpoint)


@pytest.mark.parametrize(
    "endpoint",
    [
        "tcp/0.0.0.0:7447", "tcp/[::]:7447", "tcp/localhost.evil:7447", "tcp/evil#127.0.0.1:7447", "tcp/127.0.0.1",
        "tcp/evil:1#127.0.0.1:7447", "serial//dev/ttyUSB0", "127.0.0.1:7447", "tcp/127.0.0.1:7447/x", "",
    ],
)  # fmt: skip
def test_endpoint_of_another_machine_or_none(endpoint: str) -> None:
    assert not is_local_endpoint(endpoint)


def test_host_of_an_endpoint() -> None:
    assert endpoint_host("tls/[fe80::1]:7447#iface=eth0") == "fe80::1"
    assert endpoint_host("tcp/lab-pc:7447?rel=1") == "lab-pc"


@pytest.mark.parametrize(
    ("link", "local"),
    [
        ("udp:127.0.0.1:14550", True), ("udpin:localhost:14550", True), ("serial:/dev/ttyACM0:921600", True),
        ("udpin:0.0.0.0:14550", False), ("udp:192.168.1.31:14550", False), ("udp:127.0.0.1.evil:1", False),
    ],
)  # fmt: skip
def test_a_drones_own_link(link: str, local: bool) -> None:
    assert is_local_link(link) is local
