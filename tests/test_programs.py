"""Every program, as it is asked for help or sent a command: without what it does not need."""

import os
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

from mavlink_formation import programs
from mavlink_formation.installation import install_command
from wire import version
from wire.process.system import NO_GROUND, NOT_RIGHT

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


WITHOUT = """
import sys
from importlib import import_module
from mavlink_formation import programs
missing, sys.argv = sys.argv[1].split(","), sys.argv[2:]
sys.modules.update(dict.fromkeys(missing))
getattr(programs, sys.argv.pop(0))() if sys.argv[0] in dir(programs) else import_module(sys.argv[0])
"""


def without(missing: Iterable[str], *words: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-c", WITHOUT, ",".join(missing), *words]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.processes
def test_a_bridge_needs_none_of_the_optional_parts() -> None:
    done = without([root for roots in programs._EXTRAS.values() for root in roots], "drone_agent.bridge")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.processes
def test_a_ground_needs_its_own_part_alone() -> None:
    others = [root for part, roots in programs._EXTRAS.items() if part != "ground" for root in roots]
    done = without(others, "gcs.daemon")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.processes
def test_a_missing_part_is_named_with_the_command_that_installs_it(tmp_path: Path) -> None:
    log = tmp_path / "flight.mcap"
    done = without(["matplotlib"], "gcs_log", "gcs-log", "picture", str(log))
    assert done.returncode == NOT_RIGHT
    assert done.stderr == f"gcs-log: needs matplotlib, which is not installed: {install_command('report')}\n"


@pytest.mark.processes
def test_output_that_is_lost_is_one_line_and_closed_streams_are_none() -> None:
    command = [Path(sys.executable).with_name("gcs"), "--version"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "gcs: output is lost: No space left on device\n")
    closed = subprocess.run(["/bin/sh", "-c", f"{command[0]} stop --timeout 0.01 <&- >&- 2>&-"], check=False)
    assert closed.returncode == NO_GROUND


SHOWN = "from mavlink_formation import programs; programs._run(lambda: print('15 \\u2026 \\udcff'))"


@pytest.mark.processes
@pytest.mark.parametrize("encoding", ["ascii", "ascii:strict", "latin-1", "utf-8"])
def test_an_output_that_cannot_show_a_character_gets_it_escaped(encoding: str) -> None:
    """Every program starts by this one function; the last is of a file's name that is no UTF-8."""
    environment = os.environ | {"PYTHONIOENCODING": encoding}
    done = subprocess.run([sys.executable, "-c", SHOWN], env=environment, capture_output=True, check=True)
    dots = "\u2026".encode() if encoding == "utf-8" else rb"\u2026"
    assert done.stdout.split() == [b"15", dots, rb"\udcff"]
