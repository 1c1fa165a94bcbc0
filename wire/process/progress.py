"""What a person sees while a program does what takes a while: one line on standard error, alive on a terminal."""

from collections.abc import Callable
from typing import TextIO

from formation.maths.kernel import compiling

SELDOM = 10
"""Where nobody looks on, in a file, every tenth step is enough."""


def compile_all(program: str, warm_up: Callable[[], None], stream: TextIO) -> None:
    """Run `warm_up` and print every kernel that it compiles; nothing where all are in the cache on disk."""
    compiled = 0

    def begun(name: str, count: int, total: int) -> None:
        nonlocal compiled
        compiled = count
        text = f"{program}: compiling {count} of {total}, once per installation: {name}"
        if stream.isatty():
            print(f"\r{text[:100]:100}", end="", file=stream, flush=True)
        elif count % SELDOM == 1:
            print(text, file=stream, flush=True)

    with compiling(begun):
        warm_up()
    if compiled:
        end = "\r" if stream.isatty() else ""
        print(f"{end}{f'{program}: {compiled} kernels compiled':100}".rstrip(), file=stream, flush=True)
