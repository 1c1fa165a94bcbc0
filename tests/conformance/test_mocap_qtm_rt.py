"""Qualisys' own client library, qtm-rt, reads the emulated QTM: poses, frame numbers, lost and renamed bodies."""

import asyncio
from collections.abc import Awaitable, Callable
from xml.etree import ElementTree

import numpy as np
import pytest
import qtm_rt
from qtm_rt.packet import QRTEvent, QRTPacket
from scipy.spatial.transform import Rotation

from formation.messages import RawFrame
from sim.cameras.servers.qtm import QtmServer
from tests.free_ports import free_port

NAMES = ("lead", "right", "left")
POS_M = np.array([[1.0, 2.0, 0.5], [-1.0, 0.25, 1.5], [2.345678, -3.0, 1.0]])
ROTATIONS = Rotation.random(3, random_state=1)
SEEN = np.array([True, True, False])
PERIOD_NS = 10_000_000
WITHIN_MM = 0.01


class Lab:
    """A server with three bodies at rest, the last out of sight, and a client of theirs."""

    def __init__(self) -> None:
        self.port = free_port(2)
        self.server = QtmServer("127.0.0.1", self.port, NAMES, 100.0, free_port())
        self.names = NAMES

    async def publish(self) -> None:
        number = 0
        while True:
            q = ROTATIONS.as_quat(scalar_first=True)
            self.server.publish(RawFrame(number, number * PERIOD_NS, self.names, POS_M, q, SEEN))
            number += 1
            await asyncio.sleep(0.002)


def with_client(version: str, judge: Callable[[qtm_rt.QRTConnection, Lab], Awaitable[None]]) -> None:
    async def all_of_it() -> None:
        lab = Lab()
        await lab.server.start()
        publishing = asyncio.create_task(lab.publish())
        async with asyncio.timeout(60.0):
            connection = await qtm_rt.connect("127.0.0.1", lab.port, version)
            assert connection is not None
            await judge(connection, lab)
            connection.disconnect()
        publishing.cancel()
        await asyncio.gather(publishing, return_exceptions=True)
        await lab.server.close()

    asyncio.run(all_of_it())


async def streamed(connection: qtm_rt.QRTConnection, components: list[str], count: int) -> list[QRTPacket]:
    packets: list[QRTPacket] = []
    enough = asyncio.Event()

    def take(packet: QRTPacket) -> None:
        packets.append(packet)
        if len(packets) >= count:
            enough.set()

    assert await connection.stream_frames(components=components, on_packet=take) == b"Ok"
    await enough.wait()
    await connection.stream_frames_stop()
    return packets


@pytest.mark.parametrize("version", ["1.8", "1.13", "1.19", "1.21", "1.25"])
def test_bodies_by_name_and_every_frame_by_number(version):
    async def judge(connection: qtm_rt.QRTConnection, lab: Lab) -> None:
        assert (await connection.qtm_version()).startswith(b"QTM Version is")
        assert await connection.byte_order() == b"Byte order is little endian"
        assert await connection.get_state() == QRTEvent.EventConnected
        parameters = ElementTree.fromstring(await connection.get_parameters(["6d"]))
        assert tuple(body.findtext("Name") for body in parameters.findall("The_6D/Body")) == NAMES
        packets = await streamed(connection, ["6d", "6deuler"], 50)
        numbers = np.array([packet.framenumber for packet in packets])
        np.testing.assert_array_equal(np.diff(numbers), 1)
        stamps_us = np.array([packet.timestamp for packet in packets])
        np.testing.assert_allclose(np.diff(stamps_us), PERIOD_NS / 1000, atol=2)
        for packet in packets:
            _, bodies = packet.get_6d()
            for (position, rotation), expected_m, turned in zip(bodies[:2], POS_M, ROTATIONS, strict=False):
                np.testing.assert_allclose(position, 1000.0 * expected_m, atol=WITHIN_MM)
                np.testing.assert_allclose(np.reshape(rotation.matrix, (3, 3)).T, turned.as_matrix(), atol=1e-6)
            assert np.isnan(bodies[2][0]).all()
            _, eulers = packet.get_6d_euler()
            turn = Rotation.from_euler("XYZ", eulers[0][1], degrees=True) * ROTATIONS[0].inv()
            assert turn.magnitude() < 1e-5

    with_client(version, judge)


def test_a_single_frame_and_residuals():
    async def judge(connection: qtm_rt.QRTConnection, lab: Lab) -> None:
        packet = await connection.get_current_frame(["6dres"])
        _, bodies = packet.get_6d_residual()
        np.testing.assert_allclose(bodies[0][0], 1000.0 * POS_M[0], atol=WITHIN_MM)

    with_client("1.25", judge)


def test_renamed_bodies_are_an_event_and_then_in_the_parameters():
    async def judge(connection: qtm_rt.QRTConnection, lab: Lab) -> None:
        lab.names = ("wand", "right", "left")
        await connection.await_event(QRTEvent.EventCameraSettingsChanged)
        parameters = ElementTree.fromstring(await connection.get_parameters(["6d"]))
        assert tuple(body.findtext("Name") for body in parameters.findall("The_6D/Body")) == lab.names

    with_client("1.25", judge)


def test_a_version_that_is_none_is_refused():
    async def judge(lab: Lab) -> None:
        await lab.server.start()
        assert await qtm_rt.connect("127.0.0.1", lab.port, "1.99") is None
        await lab.server.close()

    asyncio.run(judge(Lab()))
