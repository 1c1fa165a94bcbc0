"""The record beside the lab file of what counts from a restart, as doctor writes and ground reads it."""

import asyncio
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType, SimpleNamespace
from typing import TYPE_CHECKING, cast

import pytest

from formation.messages import Event, UnmetParameter
from gcs.doctor.checks import check_drone
from gcs.doctor.cli import _detect_restarts, _FixOptions, note_fixes
from gcs.doctor.restart_record import note_unmet, read_record, record_path, watch_record
from gcs.finding import Fix, Grade
from tests.gcs.doctor.test_drone import GOOD
from tests.gcs.fakes import PX4_PARAMETERS
from wire.clock import REAL_TIME

if TYPE_CHECKING:
    from gcs.doctor.survey import Survey


def test_what_the_doctor_writes_reaches_the_ground_on_its_clock_until_the_drone_has_booted(tmp_path: Path) -> None:
    lab, delivered, events = tmp_path / "lab.toml", list[UnmetParameter](), list[Event]()
    booted = dict[int, int | None]()
    before_ns = REAL_TIME.monotonic_ns()
    note_unmet(lab, 2, "EKF2_HGT_REF", 1e9)
    note_fixes(lab, [Fix(2, "EKF2_HGT_REF", 3.0)])  # the newest date of each parameter is kept
    assert len(read_record(lab)) == 1
    after_ns = REAL_TIME.monotonic_ns()

    async def watch() -> None:
        watching = asyncio.create_task(watch_record(lab, delivered.append, booted.get, events.append, REAL_TIME))
        async with asyncio.timeout(10.0):
            while not delivered:
                await asyncio.sleep(0.01)
            booted[2] = REAL_TIME.monotonic_ns()
            while read_record(lab):
                await asyncio.sleep(0.01)
            record_path(lab).write_text("[[unmet]]\nsysid = 0")
            while not events:
                await asyncio.sleep(0.01)
        watching.cancel()

    asyncio.run(watch())
    assert [(one.sysid, one.parameter) for one in delivered] == [(2, "EKF2_HGT_REF")]
    assert before_ns - 1_000_000 <= delivered[0].t_ns <= after_ns + 1_000_000  # a date is kept to a microsecond
    assert "which restarts are missing is not known" in events[0].text
    assert "lab-restarts.toml" in events[0].text


class _Restarted:
    """A survey of one drone that has restarted, and keeps one of two values."""

    drones = MappingProxyType({2: SimpleNamespace(name="left")})

    async def detect_restarts(self, _sysids: set[int], _since_ns: int) -> None:
        pass

    def booted_ns(self, _sysid: int) -> int:
        return REAL_TIME.monotonic_ns()

    async def read(self, fix: Fix) -> float:
        return 3.0 if fix.parameter == "EKF2_HGT_REF" else 0.1


def test_the_doctor_reads_back_after_the_restart_what_it_wrote(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    lab, fixes = tmp_path / "lab.toml", [Fix(2, "EKF2_HGT_REF", 3.0), Fix(2, "EKF2_EVP_NOISE", 0.01)]
    note_fixes(lab, fixes[:1])
    monkeypatch.setattr("gcs.doctor.cli.SETTLE_S", 0.0)
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    asyncio.run(_detect_restarts(cast("Survey", _Restarted()), lab, fixes, _FixOptions(wanted=True, unasked=False)))
    assert capsys.readouterr().err.splitlines()[-2:] == [
        "left: EKF2_HGT_REF kept", "left: EKF2_EVP_NOISE NOT kept: 0.1"
    ]  # fmt: skip
    assert read_record(lab) == ()


def test_the_doctor_asks_for_a_restart_until_it_has_seen_one() -> None:
    waiting = replace(GOOD, awaiting_restart=(("EKF2_HGT_REF", "counts from a restart"),))
    failed = [f for f in check_drone(waiting) if f.grade is Grade.FAIL]
    assert [(f.check, f.found) for f in failed] == [("restart for EKF2_HGT_REF", "not measured")]
    assert PX4_PARAMETERS["EKF2_HGT_REF"] == 3  # as wanted, says the drone
