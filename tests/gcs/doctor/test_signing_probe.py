"""Whether an autopilot demands signatures; pymavlink plays those that do, and those that do not."""

import asyncio
import socket
from collections.abc import Callable
from typing import Any

import pytest

from formation.config import LabConfig
from gcs.doctor.checks import check_signing
from gcs.doctor.survey import probe_signing
from gcs.finding import Finding, Grade, failed
from gcs.security.signing_probe import ASKS, ProbeOutcome, SigningProbe
from tests.free_ports import free_port
from tests.gcs.security.autopilot import NOW_US, Autopilot
from wire.link_messages import MavAutopilot
from wire.mavlink.signing import SigningChannel, StampClock, stamp_at
from wire.security.private_keys import StampFile
from wire.security.protection import Protection, Signing

KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))


def asked(autopilot: Autopilot, key: bytes = KEY, *, late: bool = False) -> ProbeOutcome:
    """A probe by hand; late: every answer comes when the next thing is asked."""
    probe = SigningProbe(2, SigningChannel(key, StampClock(), (2).__eq__))
    held = b""
    for k, signed in enumerate(ASKS):
        at_us = NOW_US + k * 500_000
        sent = probe.beat(at_us, signed=True) + probe.ask(at_us, signed=signed)
        answers = autopilot.obey(sent)
        probe.receive(held if late else answers, at_us)
        held = answers
    return probe.outcome


@pytest.mark.parametrize(
    ("autopilot", "outcome"),
    [
        (Autopilot(KEY), ProbeOutcome(True, MavAutopilot.PX4, signed_answers=3, unsigned_answers=0)),
        (Autopilot(None), ProbeOutcome(True, MavAutopilot.PX4, signed_answers=0, unsigned_answers=3)),
        (Autopilot(KEY, trusts=True), ProbeOutcome(True, MavAutopilot.PX4, 3, 3)),
        (Autopilot(OTHER_KEY), ProbeOutcome(received=True, autopilot=MavAutopilot.PX4)),
    ],
    ids=["its key", "none", "a trusted line", "another key"],
)
def test_what_an_autopilot_answers_is_counted(autopilot: Autopilot, outcome: ProbeOutcome) -> None:
    assert asked(autopilot) == outcome


def test_a_late_answer_counts_against_the_autopilot() -> None:
    assert asked(Autopilot(KEY), late=True).unsigned_answers == 1


def test_another_system_answers_for_nobody() -> None:
    probe = SigningProbe(3, SigningChannel(KEY, StampClock(), (3).__eq__))
    probe.receive(Autopilot(None).obey(probe.ask(NOW_US, signed=False)), NOW_US)
    assert probe.outcome == ProbeOutcome()


@pytest.mark.parametrize(
    ("outcome", "grade", "found"),
    [
        (ProbeOutcome(True, MavAutopilot.PX4, 3, 0), Grade.PASS, "unsigned refused"),
        (ProbeOutcome(True, MavAutopilot.PX4, 3, 1), Grade.FAIL, "unsigned obeyed"),
        (ProbeOutcome(True, MavAutopilot.PX4, 0, 1), Grade.FAIL, "unsigned obeyed"),
        (ProbeOutcome(True, MavAutopilot.PX4), Grade.FAIL, "not measured"),
        (ProbeOutcome(), Grade.FAIL, "not measured"),
    ],
)
def test_only_what_was_seen_to_refuse_passes(outcome: ProbeOutcome, grade: Grade, found: str) -> None:
    (first,) = check_signing("left", outcome, is_bridged=True)
    assert (first.grade, first.found) == (grade, found)
    assert outcome.demands_signatures is (grade is Grade.PASS)
    if grade is Grade.PASS:  # what no key closes, where no bridge stands before it
        _, warning = check_signing("left", outcome, is_bridged=False)
        assert (warning.grade, warning.found) == (Grade.WARN, "HEARTBEAT, RADIO_STATUS, ADSB_VEHICLE, COLLISION")


async def _serve(autopilot: Autopilot, run: Callable[[int], Any]) -> Any:
    """What `run` returns, beside the autopilot at a UDP port."""
    loop, served = asyncio.get_running_loop(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    served.setblocking(False)
    served.bind(("127.0.0.1", free_port()))

    def answer() -> None:
        data, sender = served.recvfrom(2048)
        answers = autopilot.obey(data)
        if answers:
            served.sendto(answers, sender)

    loop.add_reader(served, answer)
    try:
        return await run(served.getsockname()[1])
    finally:
        loop.remove_reader(served)
        served.close()


@pytest.mark.parametrize(("key", "fails"), [(KEY, False), (None, True)])
def test_the_doctor_fails_an_autopilot_that_obeys_unsigned_commands(key: bytes | None, fails: bool, tmp_path) -> None:
    """By real sockets, the drone's own link to pymavlink."""
    stamps = StampFile(tmp_path / "stamp")
    signing = Signing({2: KEY}, StampClock(stamp_at(NOW_US)), stamps, at_ground=True)

    async def examined(port: int) -> tuple[Finding, ...]:
        drone = {"body": "left", "sysid": 2, "link": f"udp:127.0.0.1:{port}", "guard": "none", "offset_m": [-1, 0, 0]}
        config = LabConfig.model_validate({"leader": {"body": "lead"}, "followers": [drone]})
        return await probe_signing(config, Protection(signing=signing))

    found = asyncio.run(_serve(Autopilot(key), examined))
    assert failed(found) is fails
    assert [finding.subject for finding in found] == ["left", "left"]
