"""What the wheel carries: the packages' own files, by folder and kind, and nothing of keys, tests or this computer."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = {"formation", "wire", "mocap", "gcs", "drone_agent", "sim", "analysis", "gcs_log", "mavlink_formation"}
KINDS = {".typed", ".py", ".toml", ".css", ".html", ".mplstyle", ".msg", ".service", ".conf"}
COMMIT = "wire/commit.txt"
METADATA = {"METADATA", "RECORD", "WHEEL", "entry_points.txt", "licenses/LICENSE"}
LARGEST_MB = 5.0

pytestmark = [pytest.mark.processes, pytest.mark.timeout(300)]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ZipFile]:
    folder = tmp_path_factory.mktemp("wheel")
    options = ("--quiet", "--disable-pip-version-check", "--no-deps", "--wheel-dir", str(folder))
    subprocess.run((sys.executable, "-m", "pip", "wheel", *options, str(ROOT)), check=True, capture_output=True)
    (path,) = folder.glob("*.whl")
    with ZipFile(path) as opened:
        yield opened


def test_it_carries_the_packages_and_nothing_else(wheel: ZipFile) -> None:
    names = [name for name in wheel.namelist() if not name.endswith("/")]
    metadata = {name.partition("/")[2] for name in names if ".dist-info/" in name}
    carried = [name for name in names if ".dist-info/" not in name]
    assert metadata == METADATA
    assert {name.partition("/")[0] for name in carried} == PACKAGES
    assert {Path(name).suffix for name in carried if name != COMMIT} <= KINDS
    assert not [name for name in carried if "keys/" in name or Path(name).name.startswith("test_")]
    assert sum(wheel.getinfo(name).file_size for name in names) < LARGEST_MB * 1e6


def test_every_module_is_there_as_it_is_here(wheel: ZipFile) -> None:
    here = {
        str(path.relative_to(ROOT)): path.read_bytes() for name in PACKAGES for path in (ROOT / name).rglob("*.py")
    }  # fmt: skip
    there = {name: wheel.read(name) for name in wheel.namelist() if name.endswith(".py")}
    assert sorted(there) == sorted(here)
    assert there == here
