"""Compiling is told of, and done once."""

import gc
import importlib.util
import re
import subprocess
import sys
from fcntl import LOCK_EX, flock
from pathlib import Path
from threading import Thread
from types import ModuleType

import numba
import pytest

from formation.maths.kernel import _cache_root, compiled_count, compiling, is_cache_temporary

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
        assert compiled_count() >= len(expected)
        assert all(total >= 2 for _, _, total in told)


def test_while_another_process_compiles_a_kernel_this_one_waits_for_it(tmp_path, monkeypatch):
    file = tmp_path / "told_kernels.py"
    file.write_text(SOURCE)
    module, results = load(file, monkeypatch), []
    with Path(numba.config.CACHE_DIR, "locks", "told_kernels.twice").open("w") as lock:
        flock(lock, LOCK_EX)
        call = Thread(target=lambda: results.append(module.fourfold(1.5)))
        call.start()
        call.join(1.0)
        assert call.is_alive()
    call.join(30.0)
    assert results == [6.0]


def test_kernels_outside_formation_call_those_of_their_own_file_or_of_formation():
    """Else numba would answer an edit of the one by yesterday's code of the other: see formation.maths.kernel."""
    files = [f for package in ("wire", "gcs", "drone_agent", "sim", "analysis") for f in (ROOT / package).rglob("*.py")]
    texts = {".".join(f.relative_to(ROOT).with_suffix("").parts): f.read_text(encoding="utf-8") for f in files}
    with_kernels = {name for name, text in texts.items() if "@kernel" in text}
    assert with_kernels
    for name in with_kernels:
        assert with_kernels.isdisjoint(re.findall(r"^from (\S+) import", texts[name], re.MULTILINE)), name


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


def test_two_copies_of_a_release_share_what_is_compiled(tmp_path, monkeypatch):
    """The folder is named by what `formation` holds, a kernel's place in it by its module: CI keeps it by these."""
    copies = [tmp_path / name / "formation" / "maths" for name in ("checkout", "installed")]
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    told = []
    for folder in copies:
        folder.mkdir(parents=True)
        (folder / "kernel.py").write_text((ROOT / "formation" / "maths" / "kernel.py").read_text())
        (folder / "twice.py").write_text(SOURCE.replace("formation.maths.kernel", "kernel"))
        asked = "import twice; twice.fourfold(1.5); print(sum(twice.fourfold.stats.cache_hits.values()))"
        done = subprocess.run([sys.executable, "-c", asked], cwd=folder, capture_output=True, text=True, check=True)
        told.append(done.stdout.strip())
    assert told == ["0", "1"]
