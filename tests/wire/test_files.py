"""Names that come from outside stay inside a folder; folders and logs are their owners' alone."""

import os
from pathlib import Path

import pytest

from wire.files import inside, make_folder
from wire.logs.mcap_write import LogWriter


def mode(path: Path) -> int:
    return path.stat().st_mode & 0o777


@pytest.mark.parametrize(
    "name", ["../../x", "/etc/passwd", "..", ".", "", ".bashrc", "a/../../b", "x\0y", "a\nb", "x" * 999]
)
def test_a_name_from_outside_stays_inside(name: str, tmp_path: Path) -> None:
    path = inside(tmp_path, name)
    assert path.parent == tmp_path
    path.touch()  # and can be had
    assert os.listdir(tmp_path) == [path.name]
    assert not path.name.startswith(".")


def test_an_ordinary_name_stays_as_it_is(tmp_path: Path) -> None:
    assert inside(tmp_path, "left-3-2026-01-01T120000Z.log").name == "left-3-2026-01-01T120000Z.log"


def test_a_new_folder_and_a_log_are_their_owners_alone(tmp_path: Path) -> None:
    folder = tmp_path / "runs" / "one"
    make_folder(folder)
    make_folder(folder)
    assert (mode(folder), mode(folder.parent)) == (0o700, 0o700)
    LogWriter(folder / "flight.mcap", {}, threaded=False).close()
    assert mode(folder / "flight.mcap") == 0o600


def test_a_folder_that_is_there_keeps_its_mode(tmp_path: Path) -> None:
    (tmp_path / "shared").mkdir(mode=0o755)
    make_folder(tmp_path / "shared" / "new")
    assert mode(tmp_path / "shared") == 0o755
