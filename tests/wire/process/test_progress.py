"""What is compiled before a first flight: by two processes at once, told of, and not a second time."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from wire.process.progress import _late_interrupt

ROOT = Path(__file__).parents[3]
KERNELS = """
from formation.maths.kernel import kernel

@kernel
def twice(x: float) -> float:
    return 2.0 * x

@kernel
def thrice(x: float) -> float:
    return 3.0 * x
"""
WARMED = """
import gc
import os
import sys
from pathlib import Path

import kernels
from wire.process.progress import compile_all

def own() -> None:
    kernels.thrice(1.0)
    Path("own").write_text(str(os.getpid()))

def ground() -> None:
    kernels.twice(1.0)
    Path("ground").write_text(str(os.getpid()))

def failing() -> None:
    raise SystemExit("it failed")

if __name__ == "__main__":
    compile_all("program", own, sys.stderr, beside=globals()[sys.argv[1]])
    assert kernels.twice(2.0) == 4.0
    assert len(gc.get_objects()) < 2_000, "a collection in flight would look at all that start-up has made"
"""


def compile_in(folder, beside="ground"):
    (folder / "kernels.py").write_text(KERNELS)
    (folder / "warmed.py").write_text(WARMED)
    environment = os.environ | {"NUMBA_CACHE_DIR": str(folder / "cache"), "PYTHONPATH": f"{ROOT}:{folder}"}
    command = [sys.executable, "warmed.py", beside]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120, check=True)


def test_two_processes_compile_a_part_each_and_later_ones_nothing(tmp_path):
    first = compile_in(tmp_path)
    assert "once per installation: kernels.thrice" in first.stderr
    assert "kernels.twice" not in first.stderr
    assert "program: 2 kernels compiled" in first.stderr
    assert (tmp_path / "own").read_text() != (tmp_path / "ground").read_text()

    (tmp_path / "ground").unlink()
    assert compile_in(tmp_path).stderr == ""
    assert not (tmp_path / "ground").exists()


@pytest.mark.nightly
def test_what_fails_in_the_other_process_is_compiled_where_it_is_called(tmp_path):
    assert "it failed" in compile_in(tmp_path, "failing").stderr
    assert compile_in(tmp_path, "failing").stderr == ""


def test_ctrl_c_while_kernels_load_waits_for_a_moment_between_them():
    steps = []

    def load_kernels():
        with _late_interrupt() as interruptible:
            os.kill(os.getpid(), signal.SIGINT)
            steps.append("goes on")
            interruptible()
            steps.append("does not get here")

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # which a shell's background job has not
    try:
        with pytest.raises(KeyboardInterrupt):
            load_kernels()
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
    assert steps == ["goes on"]
