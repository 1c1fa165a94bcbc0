"""Every program, as it is asked for help or sent a command: without what it does not need."""

import subprocess
import sys
from pathlib import Path

import pytest

from wire import version
from wire.process.exit_codes import NO_GROUND

HEAVY = ("numba", "scipy", "matplotlib", "pymavlink", "mavsdk", "qtm_rt")
PROGRAMS = ("gcs", "drone_agent", "sim", "sim.cli.log")
CLIENT = tuple(("gcs", verb, "--timeout", "0.01") for verb in ("status", "arm", "takeoff", "start", "hold", "land"))
STOP = ("gcs", "stop", "--timeout", "0.01")
ASKED = (
    *((program, "--help") for program in PROGRAMS),
    *((program, "--version") for program in PROGRAMS),
    *(("sim", "list"), ("gcs", "shape", "line", "--timeout", "0.01"), *CLIENT, STOP),
)
RUN = """
import runpy, sys
sys.argv = sys.argv[1:]
try:
    runpy.run_module(sys.argv[0], run_name="__main__")
finally:
    print(*sorted({name.split(".")[0] for name in sys.modules}), file=sys.stderr)
"""


def run(*words: str) -> tuple[str, set[str]]:
    """What the program says, and the packages it has loaded by its end."""
    done = subprocess.run([sys.executable, "-c", RUN, *words], capture_output=True, text=True, check=False)
    assert done.returncode in (0, 3), done.stderr
    return done.stdout, set(done.stderr.splitlines()[-1].split())


@pytest.mark.processes
@pytest.mark.parametrize("words", ASKED, ids=" ".join)
def test_what_only_asks_loads_no_compiler(words: tuple[str, ...]) -> None:
    said, loaded = run(*words)
    assert not loaded & set(HEAVY)
    assert words[-1] != "--version" or said == version.text() + "\n"


@pytest.mark.processes
def test_a_stop_loads_neither_arrays_nor_an_event_loop() -> None:
    _, loaded = run(*STOP)
    assert not loaded & {"numpy", "asyncio", "uvloop", "rich", "google"}


@pytest.mark.processes
def test_output_that_is_lost_is_one_line_and_closed_streams_are_none() -> None:
    command = [Path(sys.executable).with_name("gcs"), "--version"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "gcs: output is lost: No space left on device\n")
    closed = subprocess.run(["/bin/sh", "-c", f"{command[0]} stop --timeout 0.01 <&- >&- 2>&-"], check=False)
    assert closed.returncode == NO_GROUND
