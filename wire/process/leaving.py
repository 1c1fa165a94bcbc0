"""How a command's process ends beside a session of the bus that is still being closed."""

import os
import sys
import threading

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
