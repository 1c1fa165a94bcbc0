"""What a person sees while a program does what takes a while: one line on standard error, alive on a terminal."""

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TextIO

from formation.maths.kernel import compiled_count, compiling

SELDOM = 10
"""Where nobody looks on, in a file, every tenth step is enough."""
WarmUp = Callable[[], None]


def compile_all(program: str, warm_up: WarmUp, stream: TextIO, beside: WarmUp | None = None) -> None:
    """Run `warm_up` and print every kernel that it compiles; nothing where all are in the cache on disk.

    beside: a part of the same, which a process of its own compiles meanwhile; it has to be picklable.
    """
    compiled = False

    def begun(name: str, count: int, total: int) -> None:
        nonlocal compiled
        text = f"{program}: compiling {count} of {total}, once per installation: {name}"
        if stream.isatty():
            print(f"\r{text[:100]:100}", end="", file=stream, flush=True)
        elif not compiled or count % SELDOM == 1:
            print(text, file=stream, flush=True)
        compiled = True

    with compiling(begun), _in_another_process(beside):
        warm_up()
    if compiled:
        end = "\r" if stream.isatty() else ""
        print(f"{end}{f'{program}: {compiled_count()} kernels compiled':100}".rstrip(), file=stream, flush=True)


@contextmanager
def _in_another_process(beside: WarmUp | None) -> Iterator[None]:
    """Where no kernel is compiled yet: `beside` runs, and has ended at the end. What it leaves, the caller does."""
    if beside is None or compiled_count() > 0:
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
