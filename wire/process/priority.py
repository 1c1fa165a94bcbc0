"""Before whom the operating system lets this process run, and whether its memory stays where it is; Linux.

Who may is the machine's business (`ulimit -r`, `-e`, `-l`; systemd's LimitRTPRIO, LimitNICE, LimitMEMLOCK). What is not
allowed is left as it was, and reported.
"""

import os
from collections.abc import Callable
from contextlib import suppress

REAL_TIME_PRIORITY = 10
"""Of SCHED_FIFO's 1 to 99: before all ordinary processes, behind the kernel's own threads (50)."""
NICE = -10
_LOCK_ALL_ON_FAULT = 1 | 2 | 4
"""MCL_CURRENT, MCL_FUTURE and MCL_ONFAULT: pages stay once they were used; unused ones take no memory."""


def run_before_others() -> str:
    """Have the calling thread, and all that it starts, run before others; what is in force, empty where nothing is."""
    return _first_allowed(_real_time, _nice)


def raise_priority() -> str:
    """The same, with its memory locked; what is in force, in words."""
    scheduled = run_before_others()
    return f"{scheduled or f'ordinary, nice {os.getpriority(os.PRIO_PROCESS, 0)}'}, {_lock_memory()}"


def prefer_process() -> str:
    """Give a process that was started at nice 0 a higher level, where that is allowed; what is in force, in words."""
    level = os.getpriority(os.PRIO_PROCESS, 0)
    return f"nice {level}, as started" if level else _first_allowed(_nice) or "ordinary, nice 0 (no higher is allowed)"


def lower_priority() -> None:
    """Make the calling thread an ordinary one again: one that may wait, of a process that may not."""
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        with suppress(OSError):
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    if os.getpriority(os.PRIO_PROCESS, 0) < 0:
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, 0)


def _first_allowed(*requests: Callable[[], str]) -> str:
    """What the first request that is allowed returns; the empty text where none is."""
    for request in requests:
        with suppress(OSError):
            return request()
    return ""


def _real_time() -> str:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REAL_TIME_PRIORITY))
    return f"SCHED_FIFO {REAL_TIME_PRIORITY}"


def _nice() -> str:
    os.setpriority(os.PRIO_PROCESS, 0, NICE)
    return f"nice {NICE}"


def _lock_memory() -> str:
    import ctypes  # which a stop does without

    failed = ctypes.CDLL(None, use_errno=True).mlockall(_LOCK_ALL_ON_FAULT)
    return f"memory not locked ({os.strerror(ctypes.get_errno())})" if failed else "memory locked"
