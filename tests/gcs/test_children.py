"""What the ground starts beside itself: it ends with the ground, if that is killed, too."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.gcs.bus import a_lab
from wire.config_file import dump

pytestmark = pytest.mark.processes

GROUND = """
import sys, time
from pathlib import Path
from gcs.cli.children import page_process
with page_process(Path(sys.argv[1]), "main", 1.0):
    time.sleep(600.0)
"""


def test_a_page_ends_with_its_ground_however_that_ends(tmp_path: Path) -> None:
    lab = tmp_path / "lab.toml"
    lab.write_text(dump(a_lab()), encoding="utf-8")
    command = [sys.executable, "-c", GROUND, str(lab)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as ground:
        assert ground.stderr is not None
        said = ""
        while "page: http://" not in said:
            said = ground.stderr.readline()
            assert said, "the page has ended"
        ground.kill()
        ground.stderr.read()  # ends when the page, which has the same, has ended
