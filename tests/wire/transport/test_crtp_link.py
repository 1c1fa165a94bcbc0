"""Links to Crazyflies: over UDP, and by cflib's own radio driver over a dongle that is none."""

import asyncio
import socket
import time
from collections.abc import Callable, Coroutine, Iterator
from functools import wraps
from itertools import count
from struct import unpack
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

radiodriver = pytest.importorskip("cflib.crtp.radiodriver", reason="cflib is not installed")

from wire.crtp import encode_motors_off, encode_pose, encode_setpoint  # noqa: E402
from wire.transport.crtp_link import CrtpLink, open_crtp  # noqa: E402

POSE = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
LOGGED = b"\x5e\x01\x02"
AIR_S = 0.001
"""Of a packet and its answer, as a Crazyradio takes at 2 Mbit/s."""
RADIOS = count(3)
"""cflib keeps its radios by number for good."""


class Dongle(radiodriver.Crazyradio):  # type: ignore[misc]
    """Every Crazyflie answers with a packet of its log, address 0 with none; `pulled_out` as USB does."""

    version = 0.5
    present: bool
    sent: list[tuple[float, int, bytes]]

    def __init__(self, devid: int) -> None:
        if not self.present:
            raise OSError("Cannot find a Crazyradio Dongle")
        self._to = 0

    def set_address(self, address: tuple[int, ...]) -> None:
        if not self.present and address[-1] != self._to:
            raise OSError("no such device")
        self._to = address[-1]

    def send_packet(self, data: Any) -> Any:
        time.sleep(AIR_S)
        if not self.present:
            return None
        self.sent.append((time.monotonic(), self._to, bytes(data)))
        return SimpleNamespace(ack=bool(self._to), data=LOGGED if self._to else b"", retry=0, powerDet=False)

    def _none(self, *_: object) -> None:
        """What makes no difference here."""

    set_channel = set_data_rate = set_arc = close = _none


@pytest.fixture
def radio(monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    Dongle.present, Dongle.sent = True, []
    monkeypatch.setattr(radiodriver, "Crazyradio", Dongle)
    yield f"radio://{next(RADIOS)}/80/2M/E7E7E7E7"
    Dongle.present = True


def run(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    """A test that is a coroutine."""

    @wraps(test)
    def runs(**fixtures: str) -> None:
        asyncio.run(test(**fixtures))

    return runs


async def until(condition: Callable[[], object], seconds: float = 20.0) -> None:
    async with asyncio.timeout(seconds):
        while not condition():
            await asyncio.sleep(0.01)


async def opened(*uris: str) -> tuple[list[CrtpLink], list[bytes]]:
    received: list[bytes] = []
    return [await open_crtp(uri, received.append) for uri in uris], received


@run
async def test_over_udp_packets_pass_both_ways_and_of_a_kind_the_newest() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as drone:
        drone.bind(("127.0.0.1", 0))
        drone.settimeout(5.0)
        (link,), received = await opened(f"udp://127.0.0.1:{drone.getsockname()[1]}")
        try:
            link.send(encode_motors_off())
            data, sender = await asyncio.to_thread(drone.recvfrom, 64)
            while data != encode_motors_off():
                data, sender = await asyncio.to_thread(drone.recvfrom, 64)
            drone.sendto(LOGGED, sender)
            await until(lambda: received)
            assert received == [LOGGED]
        finally:
            await asyncio.to_thread(link.close)


@run
async def test_ten_drones_share_one_radio_fairly_and_are_sent_the_newest_of_a_kind(radio: str) -> None:
    links, _ = await opened(*(f"{radio}{number:02X}" for number in range(1, 11)))
    try:
        began = time.monotonic()
        for k in range(200):
            for link in links:
                link.send(encode_setpoint(0.0, 0.0, time.monotonic() - began, 1000))
                if k % 2:
                    link.send(encode_pose(*POSE))
            await asyncio.sleep(max(began + 0.01 * (k + 1) - time.monotonic(), 0.0))
    finally:
        await asyncio.gather(*(asyncio.to_thread(link.close) for link in links))
    setpoints = [(t - began, to, unpack("<f", d[9:13])[0]) for t, to, d in Dongle.sent if d[0] & 0xF3 == 0x30]
    counts = [sum(each == to for _, each, _ in setpoints) for to in range(1, 11)]
    ages_s = sorted(t - made for t, _, made in setpoints)
    print(f"setpoints/s {[round(n / 2.0) for n in counts]}, age median {ages_s[len(ages_s) // 2] * 1e3:.0f} ms, "
          f"95 % {ages_s[len(ages_s) * 95 // 100] * 1e3:.0f} ms")  # fmt: skip
    assert min(counts) > 0.7 * max(counts)
    assert ages_s[len(ages_s) // 2] < 0.1


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")  # cflib's own thread ends
@run
async def test_a_radio_that_is_pulled_out_is_lost_and_had_again(radio: str) -> None:
    uris = [f"{radio}01", f"{radio}02"]
    links, _ = await opened(*uris)
    await until(lambda: all(link.has_received for link in links))
    Dongle.present = False
    await until(lambda: all(link.lost.is_set() for link in links))
    assert [(link.radio_is_lost, link.has_received, link.why) for link in links] == [
        (True, True, "no packet for 2 s")
    ] * 2
    for link in links:
        await asyncio.to_thread(link.close)
    with pytest.raises(OSError, match="Cannot find a Crazyradio"):
        await opened(*uris)
    Dongle.present = True
    (link,), received = await opened(uris[0])
    await until(lambda: received)
    await asyncio.to_thread(link.close)


@run
async def test_a_crazyflie_that_does_not_answer_is_no_lost_radio(radio: str) -> None:
    (link,), _ = await opened(f"{radio}00")
    await link.lost.wait()
    assert (link.radio_is_lost, link.has_received, link.why) == (False, False, "Too many packets lost")
    await asyncio.to_thread(link.close)
