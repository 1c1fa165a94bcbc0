"""This process for the operating system: its name, its exit codes, its priority, its end; commands of our others.

Who may run before others is the machine's business (`ulimit -r`, `-e`, `-l`; systemd's LimitRTPRIO, LimitNICE,
LimitMEMLOCK); Linux. What is not allowed is left as it was, and reported. A stop loads this: it imports little.
"""

import os
import platform
import pwd
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

REJECTED, NOT_RIGHT, NO_GROUND, NOT_LANDED = 1, 2, 3, 4
"""Exit codes of the commands of `gcs`; 0 is done."""


def own_name() -> str:
    """`user@machine`, for the record of requests; the user's number where it has no name. Certificates prove more."""
    try:
        user = pwd.getpwuid(os.getuid()).pw_name
    except KeyError:
        user = str(os.getuid())
    return f"{user}@{os.uname().nodename}"


def machine() -> str:
    """The machine that a program runs on, for logs: host name, system, processors, Python and numpy."""
    import numpy as np

    return (
        f"{platform.node()}, {platform.system()} {platform.release()} {platform.machine()}, "
        f"{os.cpu_count()} processors, Python {platform.python_version()}, numpy {np.__version__}"
    )


def python_command(module: str, *arguments: str) -> tuple[str, ...]:
    """The command that runs `python -m module arguments` from this installation.

    A folder `sim` beside the user's lab file (`-P`, Python's safe path) or on PYTHONPATH is not imported.
    """
    return (sys.executable, "-P", "-m", "mavlink_formation", module, *arguments)


@contextmanager
def safe_path_for_pools() -> Iterator[None]:
    """While inside, the same holds for processes that `multiprocessing` starts, whose command is not ours to write."""
    before = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = before


REAL_TIME_PRIORITY = 10
"""One of SCHED_FIFO's 1 to 99: before all ordinary processes, behind the kernel's own threads (50)."""
NICE = -10


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
    """The result of the first request that is allowed; the empty text where none is."""
    for request in requests:
        with suppress(OSError):
            return request()
    return ""


def _real_time() -> str:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(REAL_TIME_PRIORITY))
    return f"SCHED_FIFO {REAL_TIME_PRIORITY}"


def _nice() -> str:
    os.setpriority(os.PRIO_PROCESS, 0, NICE)
    if os.getsid(0) == os.getpid():
        # The kernel shares the processors by sessions first (sched(7), autogroups): a nice level counts among the
        # processes of one. So who leads its own, as our mocap process does, raises that; nobody else's is changed.
        with suppress(OSError), open("/proc/self/autogroup", "w") as file:
            file.write(str(NICE))
    return f"nice {NICE}"


def _lock_memory() -> str:
    import ctypes  # which a stop does without

    # MCL_CURRENT, MCL_FUTURE and MCL_ONFAULT: pages stay once they were used; unused ones take no memory.
    failed = ctypes.CDLL(None, use_errno=True).mlockall(1 | 2 | 4)
    return f"memory not locked ({os.strerror(ctypes.get_errno())})" if failed else "memory locked"


CLOSING = "closing"
"""Name of a thread that closes what its program waits for no longer."""


def end_beside_closing(end: SystemExit) -> None:
    """End the process now where something is still being closed; else return.

    A native thread that comes back to Python while the interpreter is finalised is ended by unwinding its stack. Rust's
    frames on it then abort the process: a command that had its answer ended by SIGABRT.
    """
    if any(thread.name == CLOSING for thread in threading.enumerate()):
        if isinstance(end.code, str):
            sys.stderr.write(f"{end.code}\n")
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(end.code if isinstance(end.code, int) else int(end.code is not None))
