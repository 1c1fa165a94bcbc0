"""A deadline for code that may never return, kept by a timer's signal. Of a process's main thread alone."""

import signal
import threading
import time
from collections.abc import Callable
from math import inf
from types import FrameType

from formation.own_law.law import Answer, LawOverrunError


class Deadline:
    """Ends a call by LawOverrunError: formation.own_law.law.LawGuard.

    cpu_s: of this thread's computing, so that a busy machine is not taken for a slow call; wall_s: of any kind, for a
    call that sleeps. usual_s: of computing, which a call may exceed once and not twice. A call that is inside compiled
    code ends when that returns; one that catches every BaseException and goes on is not ended. In another thread than
    the main one, which signals do not reach, nothing is limited.
    """

    def __init__(
        self, cpu_s: float, wall_s: float, usual_s: float = inf, cpu_clock_s: Callable[[], float] = time.thread_time
    ) -> None:
        self._cpu_s, self._wall_s, self._usual_s = cpu_s, wall_s, usual_s
        self._cpu_clock_s = cpu_clock_s
        self._slow_calls = 0
        self._begun = 0.0, 0.0
        self._active = False

    def __call__(self, _now_ns: int, call: Callable[[], Answer]) -> Answer:
        """The result of `call`, if it comes in time."""
        if threading.current_thread() is not threading.main_thread():
            return call()
        signal.signal(signal.SIGALRM, self._expire)
        self._begun = self._cpu_clock_s(), time.monotonic()
        try:
            self._active = True
            signal.setitimer(signal.ITIMER_REAL, self._cpu_s, self._cpu_s)
            try:
                answer = call()
            finally:
                self._active = False
            self._judge(self._cpu_clock_s() - self._begun[0])
            return answer
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)

    def _judge(self, took_s: float) -> None:
        """LawOverrunError at the second call that took longer than usual."""
        self._slow_calls += took_s > self._usual_s
        if self._slow_calls >= 2:
            self._slow_calls = 0
            raise LawOverrunError(f"more than {1e3 * self._usual_s:g} ms twice, now {1e3 * took_s:.1f} ms")

    def _expire(self, _number: int, _frame: FrameType | None) -> None:
        """The timer rings: again and again while the call goes on."""
        cpu_s, wall_s = self._cpu_clock_s() - self._begun[0], time.monotonic() - self._begun[1]
        if self._active and (cpu_s >= 0.9 * self._cpu_s or wall_s >= self._wall_s):
            limit_s = self._cpu_s if cpu_s >= 0.9 * self._cpu_s else self._wall_s
            raise LawOverrunError(f"no answer within {1e3 * limit_s:g} ms")
