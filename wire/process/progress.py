"""The progress of a task that takes a while: one line on standard error, alive on a terminal."""

import gc
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from types import FrameType
from typing import TextIO

from formation.maths.kernel import CHANGED, compiling, kernel_counts
from formation.maths.kernel_cache import is_cache_temporary
from wire.clock import monotonic_ns

WarmUp = Callable[[], None]


def compile_all(program: str, warm_up: WarmUp, stream: TextIO, beside: WarmUp | None = None) -> None:
    """Run `warm_up` and print every kernel that it compiles; nothing where all are in the cache on disk.

    beside: a part of the same, which a process of its own compiles meanwhile; it has to be picklable. What start-up has
    made lives as long as the process: a collection of garbage in flight passes it by, and does not stop for 50 ms.
    """
    first: tuple[float, int] | None = None
    often = "for this run alone (no cache folder can be written, set XDG_CACHE_HOME)"
    often = often if is_cache_temporary() else "once per installation"

    def begun(name: str, count: int, total: int) -> None:
        nonlocal first
        interruptible()
        now_s = 1e-9 * monotonic_ns()
        first_s, first_count = first or (now_s, count)
        each_s = (now_s - first_s) / max(count - first_count, 1)
        left = f", about {each_s * (total - count):.0f} s left" if first else ""
        text = f"{program}: compiling {count} of about {total}{left}, {often}: {name}"
        if CHANGED and first is None:
            print(f"{program}: this numba's {CHANGED} is new to us: compiling takes longer", file=stream, flush=True)
        if stream.isatty():
            print(f"\r{text[:100]:100}", end="", file=stream, flush=True)
        elif first is None or count % 10 == 1:  # nobody looks on
            print(text, file=stream, flush=True)
        first = first_s, first_count

    with _late_interrupt() as interruptible, compiling(begun), _in_another_process(beside):
        warm_up()
    if first:
        end = "\r" if stream.isatty() else ""
        print(f"{end}{f'{program}: {kernel_counts()[0]} kernels compiled':100}".rstrip(), file=stream, flush=True)
    gc.collect()
    gc.freeze()


@contextmanager
def _late_interrupt() -> Iterator[Callable[[], None]]:
    """While inside, Ctrl-C raises KeyboardInterrupt only in a call of what is given, and at the end.

    Elsewhere it may meet a callback of the compiler, which prints "Exception ignored" and goes on.
    """
    interrupted = False

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        nonlocal interrupted
        interrupted = True

    def check() -> None:
        if interrupted:
            raise KeyboardInterrupt

    before = signal.getsignal(signal.SIGINT)
    if before is not signal.default_int_handler:  # an event loop's
        yield check
        return
    signal.signal(signal.SIGINT, on_signal)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
    check()


@contextmanager
def _in_another_process(beside: WarmUp | None) -> Iterator[None]:
    """Where most kernels are not compiled: `beside` runs, and has ended at the end. The caller does what it leaves."""
    compiled, known = kernel_counts()
    if beside is None or 2 * compiled > known:
        yield
        return
    other = get_context("spawn").Process(target=_compile_quietly, args=(beside,), daemon=True)
    other.start()
    try:
        yield
        other.join()
    finally:
        other.kill()


def _compile_quietly(warm_up: WarmUp) -> None:
    """Ctrl-C ends the process that this one is beside, which ends this one."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with compiling(lambda *_: None):
        warm_up()
