"""A command ends with its own exit code and output, whatever is still being closed."""

import subprocess
import sys

import pytest

COMMAND = """
import atexit, threading
from wire.process.leaving import CLOSING, end_beside_closing

atexit.register(print, "finalised")
if {closing}:
    threading.Thread(target=threading.Event().wait, name=CLOSING, daemon=True).start()
try:
    print("answered")
    raise SystemExit({code})
except SystemExit as end:
    end_beside_closing(end)
    raise
"""


@pytest.mark.parametrize(("code", "exit_code"), [("None", 0), ("3", 3), ("'what went wrong'", 1)])
@pytest.mark.parametrize("closing", [False, True])
def test_the_interpreter_is_not_finalised_beside_a_thread_that_closes(closing: bool, code: str, exit_code: int) -> None:
    command = [sys.executable, "-c", COMMAND.format(closing=closing, code=code)]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == exit_code
    assert ended.stderr == ("what went wrong\n" if exit_code == 1 else "")
    assert ended.stdout.split() == (["answered"] if closing else ["answered", "finalised"])
