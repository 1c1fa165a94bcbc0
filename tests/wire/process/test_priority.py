"""Priorities: the first way that is allowed is taken, and the report is what the operating system says."""

import json
import os
import subprocess
import sys

import pytest

from wire.process import priority


def refused(*_: object) -> None:
    raise PermissionError


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[object, ...]]:
    """The calls that would change this process; all are allowed, and none is made."""
    calls: list[tuple[object, ...]] = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda *given: calls.append(("scheduler", *given[:2])))
    monkeypatch.setattr(os, "setpriority", lambda *given: calls.append(("nice", *given)))
    monkeypatch.setattr(priority, "_lock_memory", lambda: "memory locked")
    return calls


def test_real_time_is_taken_where_it_is_allowed(asked: list[tuple[object, ...]]) -> None:
    assert priority.raise_priority() == "SCHED_FIFO 10, memory locked"
    assert asked == [("scheduler", 0, os.SCHED_FIFO)]


def test_else_a_negative_nice(asked: list[tuple[object, ...]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_setscheduler", refused)
    assert priority.raise_priority() == "nice -10, memory locked"
    assert asked == [("nice", os.PRIO_PROCESS, 0, -10)]


def test_where_nothing_is_allowed_it_is_said(asked: list[tuple[object, ...]], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "sched_setscheduler", refused)
    monkeypatch.setattr(os, "setpriority", refused)
    monkeypatch.setattr(os, "getpriority", lambda *_: 3)
    assert priority.raise_priority() == "ordinary, nice 3, memory locked"
    assert asked == []


@pytest.mark.parametrize(
    ("level", "is_allowed", "report", "calls"),
    [
        (0, True, "nice -10", [("nice", os.PRIO_PROCESS, 0, -10)]),
        (0, False, "ordinary, nice 0 (no higher is allowed)", []),
        (5, True, "nice 5, as started", []),
    ],
)
def test_a_daemon_takes_a_nice_level_and_no_real_time_where_it_was_given_none(
    asked: list[tuple[object, ...]], monkeypatch: pytest.MonkeyPatch, level: int, is_allowed: bool, report: str,
    calls: list[tuple[object, ...]],
) -> None:  # fmt: skip
    monkeypatch.setattr(os, "getpriority", lambda *_: level)
    if not is_allowed:
        monkeypatch.setattr(os, "setpriority", refused)
    assert priority.prefer_process() == report
    assert asked == calls


TRUTH = """
import json, os, threading
from wire.process.priority import lower_priority, raise_priority

def scheduling():
    return os.sched_getscheduler(0), os.sched_getparam(0).sched_priority, os.getpriority(os.PRIO_PROCESS, 0)

report, own, thread = raise_priority(), scheduling(), []
locked_kb = next(line.split()[1] for line in open("/proc/self/status") if line.startswith("VmLck:"))
def run():
    thread.append(scheduling())
    lower_priority()
    thread.append(scheduling())
started = threading.Thread(target=run)
started.start()
started.join()
print(json.dumps([report, own, thread, int(locked_kb), scheduling()]))
"""


def test_the_report_is_true_of_a_process_and_of_its_threads_but_those_made_ordinary() -> None:
    """Whatever this machine allows."""
    done = subprocess.run([sys.executable, "-c", TRUTH], capture_output=True, text=True, check=True, timeout=60)
    report, own, (inherited, lowered), locked_kb, after = json.loads(done.stdout)
    scheduler, level, nice = own
    assert {os.SCHED_FIFO: f"SCHED_FIFO {level}", os.SCHED_OTHER: f"nice {nice}"}[scheduler] in report
    assert ("memory locked" in report) == (locked_kb > 0)
    assert inherited == after == own
    assert lowered == [os.SCHED_OTHER, 0, max(nice, 0)]
