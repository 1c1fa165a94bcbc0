"""CRTP against cflib's own classes, byte for byte."""

import random
from math import nan
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from wire import crtp

pytest.importorskip("cflib", reason="cflib is not installed: pip install 'mavlink-formation[crazyflie]'")
from cflib.crazyflie.commander import Commander
from cflib.crazyflie.localization import Localization
from cflib.crazyflie.log import LogConfig, LogTocElement
from cflib.crazyflie.supervisor import Supervisor
from cflib.crtp.crtpstack import CRTPPacket


class Recorder:
    """In the place of cflib's Crazyflie: keeps what is sent."""

    def __init__(self, version: int) -> None:
        self.sent: list[bytes] = []
        self.platform = SimpleNamespace(get_protocol_version=lambda: version)
        self.supervisor = Supervisor(self)

    def add_port_callback(self, *_: Any) -> None: ...

    def send_packet(self, packet: CRTPPacket, expected_reply: Any = ()) -> None:
        self.sent.append(bytes((packet.header, *packet.data)))


@pytest.mark.filterwarnings("ignore:The supervisor subsystem")
@pytest.mark.filterwarnings("ignore:localization.send_emergency_stop")
@pytest.mark.parametrize("version", [7, 12])
def test_packets_are_those_of_cflib(version: int) -> None:
    cf = Recorder(version)
    Commander(cf).send_setpoint(12.5, -3.25, 90.0, 36000)
    Commander(cf).send_stop_setpoint()
    Localization(cf).send_extpose((1.0, -2.0, 0.5), (0.1, 0.2, 0.3, 0.9))
    cf.supervisor.send_emergency_stop()
    cf.supervisor.send_arming_request(True)
    cf.supervisor.send_arming_request(False)
    assert cf.sent == [
        crtp.encode_setpoint(12.5, -3.25, 90.0, 36000),
        crtp.encode_motors_off(),
        crtp.encode_pose(np.array([1.0, -2.0, 0.5]), np.array([0.9, 0.1, 0.2, 0.3])),
        crtp.encode_emergency_stop(version),
        crtp.encode_arming(version, True),
        crtp.encode_arming(version, False),
    ]


@pytest.mark.parametrize("block", [variables for _, variables in crtp.BLOCKS])
def test_log_blocks_are_created_and_read_as_by_cflib(block: dict[str, int]) -> None:
    cf: Any = Recorder(7)
    numbers = {name: 300 + i for i, name in enumerate(block)}
    cf.log = SimpleNamespace(log_blocks=[], toc=SimpleNamespace(get_element_id=numbers.__getitem__))
    theirs = LogConfig("block", 10)
    for name, kind in block.items():
        theirs.add_variable(name, LogTocElement.get_cstring_from_id(kind))
    theirs.cf, theirs.useV2, theirs.id = cf, True, 1
    theirs.create()
    ours = crtp.create_block(1, [(kind, numbers[name]) for name, kind in block.items()])
    assert cf.sent == [ours.packet]
    assert len(ours.packet) <= 31
    layout = crtp.Struct("<" + "".join(LogTocElement.get_unpack_string_from_id(k)[1:] for k in block.values()))
    assert layout.size <= LogConfig.MAX_LEN
    data = layout.pack(*range(1, len(block) + 1))
    read: list[dict[str, float]] = []
    theirs.data_received_cb.add_callback(lambda _t, values, _block: read.append(values))
    theirs.unpack_log_data(data, 0)
    assert crtp.LogBlock(tuple(block), layout).read(b"\x5e\x01\x10\x27\x00" + data) == (10_000, read[0])


@pytest.mark.parametrize(
    ("text", "is_one"),
    [
        ("radio://0/80/2M/E7E7E7E701", True), ("udp://127.0.0.1:19850", True), ("radio://0/80/2M", False),
        ("radio://0/80/9M/E7E7E7E701", False), ("udp:127.0.0.1:14580", False), ("usb://0", False),
    ],
)  # fmt: skip
def test_addresses(text: str, is_one: bool) -> None:
    assert crtp.is_address(text) is is_one


@pytest.mark.parametrize(
    ("kind", "value", "written"),
    [(0x08, 2.0, b"\x02"), (0x06, 0.5, b"\x00\x00\x00\x3f"), (0x08, 300.0, None), (0x06, nan, None), (0x07, 1.0, None)],
)
def test_a_parameter_is_written_as_its_type_has_it(kind: int, value: float, written: bytes | None) -> None:
    request = crtp.write_parameter(crtp.Item(258, kind), value)
    assert (request and request.packet) == (None if written is None else b"\x2e\x02\x01" + written)


def test_a_dialogue_takes_any_replies() -> None:
    chance = random.Random(1)
    for _ in range(300):
        dialogue = crtp.connect()
        request = next(dialogue)
        try:
            for _ in range(200):
                end = 1 + request.echoed
                reply = request.packet[:end] + chance.randbytes(chance.randrange(30))
                assert request.is_answered_by(reply)
                request = dialogue.send(reply)
        except StopIteration:
            pass
