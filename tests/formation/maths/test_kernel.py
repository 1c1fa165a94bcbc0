"""Compiling is told of, and done once."""

import gc
import importlib.util
import os
import shutil
import subprocess
import sys
from fcntl import LOCK_EX, flock
from pathlib import Path
from threading import Thread
from types import ModuleType

import numba
import pytest

from formation.maths.kernel import compiling, kernel_counts
from formation.maths.kernel_cache import _cache_root, is_cache_temporary

ROOT = Path(__file__).resolve().parents[3]
SOURCE = """
from formation.maths.kernel import kernel

@kernel
def twice(x: float) -> float:
    return 2.0 * x

@kernel
def fourfold(x: float) -> float:
    return twice(twice(x))
"""


def load(file: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    spec = importlib.util.spec_from_file_location("told_kernels", file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "told_kernels", module)
    spec.loader.exec_module(module)
    return module


def test_each_kernel_that_is_compiled_is_told_of_once_and_none_that_is_cached(tmp_path, monkeypatch):
    file = tmp_path / "told_kernels.py"
    file.write_text(SOURCE)
    for expected in (["told_kernels.fourfold", "told_kernels.twice"], []):
        module, told = load(file, monkeypatch), []
        with compiling(lambda name, count, total, told=told: told.append((name, count, total))):
            assert not gc.isenabled()
            assert module.fourfold(1.5) == 6.0
        assert gc.isenabled()
        assert [name for name, _, _ in told] == expected
        counts = [count for _, count, _ in told]
        assert counts == sorted(counts)
        assert kernel_counts()[0] >= len(expected)
        assert all(total >= 2 for _, _, total in told)


def test_while_another_process_compiles_a_kernel_this_one_waits_for_it(tmp_path, monkeypatch):
    file = tmp_path / "told_kernels.py"
    file.write_text(SOURCE)
    module, results = load(file, monkeypatch), []
    with Path(numba.config.CACHE_DIR, "locks", "told_kernels.fourfold").open("w") as lock:
        flock(lock, LOCK_EX)
        call = Thread(target=lambda: results.append(module.fourfold(1.5)))
        call.start()
        call.join(1.0)
        assert call.is_alive()
    call.join(30.0)
    assert results == [6.0]


def test_where_no_cache_folder_can_be_written_kernels_go_with_the_process(tmp_path, monkeypatch):
    """As in a service: a home that is not there, a read-only program."""
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.setenv("HOME", "/dev/null")
    monkeypatch.setattr("os.access", lambda *_: False)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    root = _cache_root()
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(root / "kernels"))
    assert root.parent == tmp_path
    assert is_cache_temporary()


def test_copies_share_what_is_compiled_and_an_edit_of_what_it_is_made_of_compiles_anew(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    asked = "import ours; print(ours.fourfold(1.5), sum(ours.fourfold.stats.cache_hits.values()))"
    printed = []
    for copy, factor in (("checkout", "2.0"), ("installed", "2.0"), ("installed", "3.0")):
        maths = tmp_path / copy / "formation" / "maths"
        maths.mkdir(parents=True, exist_ok=True)
        for package in (maths, maths.parent):
            (package / "__init__.py").touch()
        for file in (ROOT / "formation" / "maths").glob("kernel*.py"):
            shutil.copy(file, maths)
        (maths.parents[1] / "parts.py").write_text(f"FACTOR = {factor}\n")
        (maths.parents[1] / "ours.py").write_text("from parts import FACTOR\n" + SOURCE.replace("2.0", "FACTOR"))
        command = [sys.executable, "-B", "-c", asked]  # Python itself takes an edit within a second for none
        done = subprocess.run(command, cwd=maths.parents[1], capture_output=True, text=True, check=True)
        printed.append(done.stdout.strip())
    assert printed == ["6.0 0", "6.0 1", "13.5 0"]


@pytest.mark.parametrize("method", ["codegen.JITCodeLibrary.add_linking_library", "dispatcher.Dispatcher.get_overload"])
def test_a_numba_of_other_insides_compiles_the_plain_way_and_it_is_said_in_one_line(tmp_path, method):
    (tmp_path / "told_kernels.py").write_text(SOURCE)
    asked = f"""
import sys
from numba.core import codegen, dispatcher
known = {method}
{method} = lambda self, renamed: known(self, renamed)
from wire.process.progress import compile_all
import told_kernels
compile_all("gcs", lambda: print(told_kernels.fourfold(1.5)), sys.stdout)
"""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": f"{ROOT}:{tmp_path}"}
    command = [sys.executable, "-c", asked]
    told = subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout.splitlines()
    name = method.partition(".")[2]
    assert [k for k, line in enumerate(told) if f"numba's {name} is new" in line] == [0]
    assert "6.0" in told
