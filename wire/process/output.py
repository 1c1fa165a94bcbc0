"""A daemon's output: what its terminal, pipe or disk does not take is dropped and counted. It stops no flight."""

import io
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from queue import Full, Queue
from threading import Lock, Thread
from typing import Any


class DroppingStream(io.TextIOBase):
    """A text stream to a descriptor that never raises and never waits: a thread of its own writes."""

    encoding, errors = "utf-8", "backslashreplace"

    def __init__(self, descriptor: int) -> None:
        self.lost_lines = 0
        self._descriptor = descriptor
        self._text = ""
        self._lock = Lock()
        self._pieces: Queue[bytes] = Queue(1000)
        Thread(target=self._write_pieces, name="output", daemon=True).start()

    def write(self, text: str) -> int:
        """Pass the text on, with the end of its line."""
        with self._lock:
            self._text += text
        if "\n" in text:
            self.flush()
        return len(text)

    def flush(self) -> None:
        """Pass on what there is, without waiting until it is written."""
        with self._lock:
            piece, self._text = self._text.encode(self.encoding, self.errors), ""
            try:
                if piece:
                    self._pieces.put_nowait(piece)
            except Full:
                self.lost_lines += piece.count(b"\n")

    def drain(self) -> None:
        """Wait until everything is written, within a limit."""
        self.flush()
        with self._pieces.all_tasks_done:
            self._pieces.all_tasks_done.wait_for(lambda: not self._pieces.unfinished_tasks, timeout=1.0)

    def isatty(self) -> bool:
        """Whether a person looks on."""
        return os.isatty(self._descriptor)

    def fileno(self) -> int:
        """The descriptor."""
        return self._descriptor

    def _write_pieces(self) -> None:
        noted = 0
        while True:
            piece, lost = self._pieces.get(), self.lost_lines
            left = f"({lost - noted} lines were lost here)\n".encode() + piece if lost > noted else piece
            try:
                while left:
                    left = left[os.write(self._descriptor, left) :]
                noted = lost
            except OSError:
                with self._lock:
                    self.lost_lines += piece.count(b"\n")
            self._pieces.task_done()


@contextmanager
def dropping_output() -> Iterator[None]:
    """While inside, both standard streams drop what is not taken, and a terminal that closes ends nothing."""
    hung_up = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    out, err = _dropping(sys.stdout), _dropping(sys.stderr)
    if out is not sys.stdout and err is not sys.stderr and os.path.sameopenfile(out.fileno(), err.fileno()):
        err = out  # one thread keeps the order of their lines
    try:
        with redirect_stdout(out), redirect_stderr(err):
            yield
    finally:
        for stream in (out, err):
            if isinstance(stream, DroppingStream):
                stream.drain()
        signal.signal(signal.SIGHUP, hung_up)


def _dropping(stream: Any) -> Any:
    """The stream's counterpart that drops; itself where it is only in memory, or drops already."""
    try:
        return stream if isinstance(stream, DroppingStream) else DroppingStream(stream.fileno())
    except OSError:
        return stream


def lost_lines() -> int:
    """How many lines both streams have lost."""
    return sum(stream.lost_lines for stream in {sys.stdout, sys.stderr} if isinstance(stream, DroppingStream))
