"""Processes that a command starts beside itself, and ends with itself."""

import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from wire.process.system import python_command


@contextmanager
def page_process(lab: Path, name: str, speed: float, insecure: bool = False) -> Iterator["subprocess.Popen[bytes]"]:
    """While inside, a page is served by a process of its own, which ends with us, even if we are killed.

    Whatever becomes of it, nothing here waits for it.
    """
    words = ["page", str(lab), "--name", name, "--speed", str(speed), "--with-parent"]
    words += ["--insecure"] if insecure else []
    command = python_command("gcs", *words)
    # A session of its own: Ctrl-C is the ground's, which lands before it ends, and is watched meanwhile.
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(5.0)
        except subprocess.TimeoutExpired:
            process.kill()
