"""`gcs stop` on its short way: which words it understands itself, and with what it ends."""

import json
from pathlib import Path

import pytest

from formation.requests import ANSWER_S
from gcs.cli.stop import stop
from tests.free_ports import free_port
from wire.process.system import NO_GROUND, NOT_RIGHT
from wire.transport.zenoh_session import FIND_S, Patience, _is_out_of_patience, open_session


@pytest.mark.parametrize("words", [["--help"], ["--json", "--help"], ["--lab"], ["now"], ["--timeout", "soon"]])
def test_what_it_does_not_understand_is_left_to_the_whole_command_line(words: list[str]):
    assert stop(words) is None


def _lab(folder: Path, port: int) -> Path:
    path = folder / "lab.toml"
    path.write_text(f'name = "here"\n[link]\nzenoh_connect = ["tcp/127.0.0.1:{port}"]\n')
    return path


def test_no_ground_and_no_lab_are_said_in_json_too(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    port = free_port()
    assert stop(["--json", f"--lab={_lab(tmp_path, port)}", "--timeout", "0.1", "--name=main"]) == NO_GROUND
    told = capsys.readouterr()
    assert f"nobody listens at tcp/127.0.0.1:{port}" in json.loads(told.out)["error"]
    assert "gcs run lab.toml" in told.err
    assert stop(["--lab", str(tmp_path / "no.toml")]) == NOT_RIGHT
    assert "no.toml" in capsys.readouterr().err


def test_gives_up_early_where_nobody_listens_and_asks_on_where_the_bus_is_there_and_no_ground():
    """A busy ground may be found late: a stop is not given up for that."""
    silent, patient = (f"tcp/127.0.0.1:{free_port()}",), Patience(ANSWER_S, ground_s=ANSWER_S)
    assert _is_out_of_patience(FIND_S * 1.1, silent, patient)
    assert not _is_out_of_patience(ANSWER_S / 2, (), patient)
    assert _is_out_of_patience(ANSWER_S / 2, (), Patience(ANSWER_S))


def test_says_that_the_bus_is_there_without_a_ground(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    endpoint = f"tcp/127.0.0.1:{(port := free_port())}"
    with open_session((endpoint,), (), "here"):
        assert stop([f"--lab={_lab(tmp_path, port)}", "--timeout", "0.3"]) == NO_GROUND
    assert "on the bus nobody serves here/gcs/main/do" in capsys.readouterr().err
