import asyncio
from struct import pack

import pytest

from formation.mocap_config import MocapConfig
from mocap.discover import (
    Finding,
    Ports,
    discover,
    natnet_finding,
    natnet_request,
    qtm_finding,
    qtm_request,
    vrpn_finding,
)
from sim.cameras.servers.natnet import natnet_server
from tests.free_ports import free_port
from wire.clock import REAL_TIME

SERVER_INFO = (
    bytes.fromhex("010017014d6f7469766500")
    + bytes(249)
    + bytes.fromhex("0201000003000000938c320000000000e70501efff2a63")
)
"""Recorded from Motive 2.1 (github.com/mje-nz/python_natnet, serverinfo_packet_v3.bin)."""
QTM_TEXT = b"LAB-PC, QTM 2.14 (build 3180), 12 cameras\0"


def qtm_answer(text: bytes = QTM_TEXT, port: int = 22222) -> bytes:
    """As qtm_rt.discovery takes it apart: size, type 1, text, base port of which the order is the network's."""
    return pack("<II", 8 + len(text) + 2, 1) + text + pack(">H", port)


def test_natnet_is_asked_for_with_message_14_and_answers_with_its_information():
    request = natnet_request()
    assert request[:4] == bytes.fromhex("0e000801")
    assert request.endswith(bytes.fromhex("0300000003000000"))
    assert len(request) == 268
    assert natnet_finding(SERVER_INFO, "10.0.0.1") == Finding(
        "natnet", "10.0.0.1", "Motive 2.1.0.0", "NatNet 3.0, multicast 239.255.42.99"
    )


def test_qtm_is_asked_for_as_qtm_rt_does():
    """qtm_rt 3.1's discovery packet for answers to port 40001."""
    assert qtm_request(40_001) == bytes.fromhex("0a000000070000009c41")
    assert qtm_finding(qtm_answer(), "10.0.0.2") == Finding(
        "qualisys", "10.0.0.2:22222", "LAB-PC", "QTM 2.14 (build 3180), 12 cameras"
    )
    hostile = qtm_finding(qtm_answer(b"\x1b[2J" + b"x" * 500 + b"\0"), "h")
    assert hostile.name.isprintable()
    assert len(hostile.name) <= 128


def test_a_vrpn_server_says_its_version():
    assert vrpn_finding(b"vrpn: ver. 07.35  0\0\0\0\0\0", "h:3883") == Finding("vrpn", "h:3883", "", "07.35")
    assert vrpn_finding(b"SSH-2.0-OpenSSH_9.6\r\n   ", "h:3883") is None


@pytest.mark.parametrize("read", [natnet_finding, qtm_finding])
def test_anything_else_is_no_finding(read):
    whole = {natnet_finding: SERVER_INFO, qtm_finding: qtm_answer()}[read]
    assert read(whole, "h") is not None
    for end in range(len(whole)):
        assert read(whole[:end], "h") is None
    for start in range(4):  # what kind it is, and how long
        assert read(whole[:start] + bytes([255 - whole[start]]) + whole[start + 1 :], "h") is None


def test_what_is_there_is_found_and_what_is_not_costs_the_wait_only():
    async def look() -> list[Finding]:
        port = free_port(5)
        natnet = {"host": "127.0.0.1", "command_port": port, "data_port": port + 1, "multicast": ""}
        server = natnet_server(MocapConfig.model_validate({"source": "natnet", "natnet": natnet}), ("lead",), REAL_TIME)
        await server.start()

        async def greet(_: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            writer.write(b"vrpn: ver. 07.30  0\0\0\0\0\0")
            await writer.drain()
            writer.close()

        async with await asyncio.start_server(greet, "127.0.0.1", port + 2):
            try:
                ports = Ports(natnet=port, qtm=port + 4, vrpn=(port + 2, port + 3), vicon=port + 2)
                return await discover(["127.0.0.1", "no.such.host.invalid"], 1.0, ports)
            finally:
                await server.close()

    found = asyncio.run(look())
    assert [(each.protocol, each.name, each.version) for each in found] == [
        ("natnet", "Motive 3.1.0.0", "NatNet 4.1, unicast"),
        ("vicon", "", ""),
        ("vrpn", "", "07.30"),
    ]
