"""`gcs stop` on its short way: which words it understands itself, and with what it ends."""

from pathlib import Path

import pytest
from free_ports import free_port

from gcs.cli.exit_codes import NO_GROUND, NOT_RIGHT
from gcs.cli.stop import stop


@pytest.mark.parametrize("words", [["--help"], ["--json"], ["--lab"], ["now"], ["--timeout", "soon"]])
def test_what_it_does_not_understand_is_left_to_the_whole_command_line(words: list[str]):
    assert stop(words) is None


def test_a_lab_that_is_not_there_is_not_right(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert stop(["--lab", str(tmp_path / "no.toml")]) == NOT_RIGHT
    assert "no.toml" in capsys.readouterr().err


def test_no_ground_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    lab = tmp_path / "lab.toml"
    lab.write_text(f'name = "here"\n[link]\nzenoh_connect = ["tcp/127.0.0.1:{free_port()}"]\n')
    assert stop([f"--lab={lab}", "--timeout", "0.1", "--name=main"]) == NO_GROUND
    assert "no answer on here/gcs/main/do within 0.1 s" in capsys.readouterr().err
