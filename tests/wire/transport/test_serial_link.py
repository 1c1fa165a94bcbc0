"""A serial line to an autopilot, played by a pseudo-terminal."""

import asyncio
import os
import tty

import pytest

from formation.messages import Datagram
from tests.gcs.security.autopilot import Autopilot, on_a_line
from tests.wire.waiting import in_loop
from wire.link_messages import GROUND, Address, MavCommand, command_long
from wire.mavlink.codec import Codec
from wire.mavlink.signing import SigningChannel, StampClock
from wire.transport.serial_link import open_serial


@in_loop
async def test_bytes_go_both_ways_unchanged() -> None:
    master, slave = os.openpty()
    tty.setraw(master)
    arrived: asyncio.Queue[Datagram] = asyncio.Queue()
    try:
        link = await open_serial(f"serial:{os.ttyname(slave)}:57600", 4, arrived.put_nowait)
        try:
            everything = bytes(range(256))
            os.write(master, everything)
            got = b""
            while len(got) < len(everything):
                datagram = await asyncio.wait_for(arrived.get(), 5.0)
                assert datagram.sysid == 4
                got += datagram.data
            assert got == everything
            link.send(Datagram(4, everything))
            back = b""
            while len(back) < len(everything):
                back += os.read(master, 256)
            assert back == everything
            assert link.counters.sent == 1
        finally:
            link.close()
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize("text", ["serial:/dev/ttyS0", "udp:h:1", "serial::57600", "serial:/dev/ttyS0:fast"])
def test_text_that_is_no_line(text: str) -> None:
    with pytest.raises(ValueError, match="serial:DEV:BAUD"):
        asyncio.run(open_serial(text, 1, lambda datagram: None))


def test_a_line_that_is_not_there() -> None:
    with pytest.raises(OSError, match="nowhere"):
        asyncio.run(open_serial("serial:/dev/nowhere:57600", 1, lambda datagram: None))


def test_an_autopilot_that_demands_signatures_obeys_what_the_line_signs() -> None:
    """pymavlink judges; what comes back passes as it came."""
    key = bytes(range(32))

    async def talk() -> None:
        arrived: asyncio.Queue[Datagram] = asyncio.Queue()
        with on_a_line(Autopilot(key)) as line:
            for channel, answers in ((None, False), (SigningChannel(key, StampClock(), (2).__eq__), True)):
                link = await open_serial(f"serial:{line}:57600", 2, arrived.put_nowait, channel)
                try:
                    command = command_long(Address(2, 1), MavCommand.REQUEST_MESSAGE, 148.0)
                    link.send(Datagram(2, Codec(GROUND).encode(command)))
                    if answers:
                        assert (await asyncio.wait_for(arrived.get(), 5.0)).data[:1] == b"\xfd"
                    else:
                        with pytest.raises(TimeoutError):
                            await asyncio.wait_for(arrived.get(), 0.3)
                finally:
                    link.close()

    asyncio.run(talk())
