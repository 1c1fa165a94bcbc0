"""A process for the operating system: its priority and its end.

The first way that is allowed is taken, and the report is what the operating system says.
"""

import json
import os
import subprocess
import sys

import pytest

from wire.process import system

FIFO, NICE = ("scheduler", 0, os.SCHED_FIFO), ("nice", os.PRIO_PROCESS, 0, -10)


@pytest.mark.parametrize(
    ("raised", "allowed", "level", "report", "made"),
    [
        ("raise_priority", {"scheduler", "nice"}, 3, "SCHED_FIFO 10, memory locked", [FIFO]),
        ("raise_priority", {"nice"}, 3, "nice -10, memory locked", [NICE]),
        ("raise_priority", set(), 3, "ordinary, nice 3, memory locked", []),
        # A daemon takes a nice level, and no real time, where it was given none.
        ("prefer_process", {"nice"}, 0, "nice -10", [NICE]),
        ("prefer_process", set(), 0, "ordinary, nice 0 (no higher is allowed)", []),
        ("prefer_process", {"scheduler", "nice"}, 5, "nice 5, as started", []),
    ],
)
def test_the_first_way_that_is_allowed_is_taken(raised, allowed, level, report, made, monkeypatch) -> None:
    calls: list[tuple[object, ...]] = []

    def asked(*given: object) -> None:
        if given[0] not in allowed:
            raise PermissionError
        calls.append(given)

    monkeypatch.setattr(os, "sched_setscheduler", lambda *given: asked("scheduler", *given[:2]))
    monkeypatch.setattr(os, "setpriority", lambda *given: asked("nice", *given))
    monkeypatch.setattr(os, "getpriority", lambda *_: level)
    monkeypatch.setattr(system, "_lock_memory", lambda: "memory locked")
    assert getattr(system, raised)() == report
    assert calls == made


TRUTH = """
import json, os, threading
from wire.process.system import lower_priority, raise_priority

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


COMMAND = """
import atexit, threading
from wire.process.system import CLOSING, end_beside_closing

atexit.register(print, "finalised")
if {closing}:
    threading.Thread(target=threading.Event().wait, name=CLOSING, daemon=True).start()
try:
    print("answered")
    raise SystemExit({code})
except SystemExit as end:
    end_beside_closing(end)
    raise
"""


@pytest.mark.parametrize(("code", "exit_code"), [("None", 0), ("3", 3), ("'what went wrong'", 1)])
@pytest.mark.parametrize("closing", [False, True])
def test_the_interpreter_is_not_finalised_beside_a_thread_that_closes(closing: bool, code: str, exit_code: int) -> None:
    command = [sys.executable, "-c", COMMAND.format(closing=closing, code=code)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == exit_code
    assert ended.stderr == ("what went wrong\n" if exit_code == 1 else "")
    assert ended.stdout.split() == (["answered"] if closing else ["answered", "finalised"])


@pytest.mark.parametrize("own_session", [True, False])
def test_a_session_of_its_own_is_raised_with_it_and_nobody_elses(own_session: bool) -> None:
    """Where the kernel groups by sessions, a nice level counts inside of one alone."""
    code = (
        "import os; from pathlib import Path; from wire.process.system import prefer_process; "
        "group = Path('/proc/self/autogroup'); before = group.read_text() if group.exists() else ''; "
        "report = prefer_process(); after = group.read_text() if group.exists() else ''; "
        "print(report, before.split()[-1:] , after.split()[-1:], sep='|')"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code], check=True, start_new_session=own_session, capture_output=True, text=True
    )
    report, before, after = ran.stdout.strip().split("|")
    raised = own_session and report == "nice -10" and before != "[]"
    assert after == ("['-10']" if raised else before)
