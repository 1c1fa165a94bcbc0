"""A deadline for code that may never return, kept by a timer's signal. Of a process's main thread alone."""

import signal
import threading
import time
from collections.abc import Callable
from types import FrameType

from formation.own_law.guard import Answer, LawOverrunError


class Deadline:
    """Ends a call by LawOverrunError: formation.own_law.guard.LawGuard.

    cpu_s: of this thread's computing, so that a busy machine is not taken for a slow call; wall_s: of any kind, for a
    call that sleeps. A call that is inside compiled code ends when that returns; one that catches every BaseException
    and goes on is not ended. In another thread than the main one, which signals do not reach, nothing is limited.
    """

    def __init__(self, cpu_s: float, wall_s: float) -> None:
        self._cpu_s, self._wall_s = cpu_s, wall_s
        self._begun = 0.0, 0.0
        self._active = False

    def __call__(self, _now_ns: int, call: Callable[[], Answer]) -> Answer:
        """What `call` returns, if it does in time."""
        if threading.current_thread() is not threading.main_thread():
            return call()
        signal.signal(signal.SIGALRM, self._expire)
        self._begun = time.thread_time(), time.monotonic()
        try:
            self._active = True
            signal.setitimer(signal.ITIMER_REAL, self._cpu_s, self._cpu_s)
            try:
                return call()
            finally:
                self._active = False
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _expire(self, _number: int, _frame: FrameType | None) -> None:
        """The timer rings: again and again while the call goes on."""
        cpu_s, wall_s = time.thread_time() - self._begun[0], time.monotonic() - self._begun[1]
        if self._active and (cpu_s >= 0.9 * self._cpu_s or wall_s >= self._wall_s):
            limit_s = self._cpu_s if cpu_s >= 0.9 * self._cpu_s else self._wall_s
            raise LawOverrunError(f"no answer within {1e3 * limit_s:g} ms")
