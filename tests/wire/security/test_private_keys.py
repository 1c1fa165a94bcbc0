"""Folders of keys are their owner's alone, no key is ever shown, and the newest stamp outlives a process."""

import os
from pathlib import Path

import pytest

from wire.errors import ConfigError
from wire.security.private_keys import (
    StampFile,
    demand_private,
    demand_private_tree,
    read_mavlink_key,
    read_name,
    write_private,
)

KEY = "ab" * 32


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o660, 0o644, 0o666, 0o610, 0o601])
def test_a_file_open_to_others_is_refused(mode: int, tmp_path: Path) -> None:
    path = tmp_path / "private.pem"
    path.write_text("x")
    path.chmod(mode)
    with pytest.raises(ConfigError, match=r"open to others \(mode .*\): chmod 600"):
        demand_private(path)
    path.chmod(0o600)
    demand_private(path)


def test_a_folder_is_refused_for_one_open_file_in_it(tmp_path: Path) -> None:
    folder = tmp_path / "keys"
    folder.mkdir(mode=0o700)
    write_private(folder / "private.pem", b"x")
    demand_private_tree(folder)
    (folder / "private.pem").chmod(0o640)
    with pytest.raises(ConfigError, match=r"private\.pem: open to others"):
        demand_private_tree(folder)
    (folder / "private.pem").chmod(0o600)
    folder.chmod(0o750)
    with pytest.raises(ConfigError, match="chmod 700"):
        demand_private_tree(folder)


def test_keys_that_are_missing_name_the_command(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="gcs keys new"):
        demand_private(tmp_path / "keys")


def test_what_is_written_is_private_whatever_the_mask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        write_private(tmp_path / "a", b"x")
    finally:
        os.umask(before)
    assert (tmp_path / "a").stat().st_mode & 0o777 == 0o600
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


@pytest.mark.parametrize("text", [KEY[:-1], KEY + "00", KEY[:-1] + "g", "", "secret" * 10])
def test_a_wrong_key_is_not_in_its_error(text: str, tmp_path: Path) -> None:
    path = tmp_path / "mavlink-1.key"
    path.write_text(text)
    with pytest.raises(ConfigError, match="not a key of 64 hexadecimal digits") as caught:
        read_mavlink_key(path)
    assert not text or text not in str(caught.value)
    assert KEY[:8] not in str(caught.value)


def test_a_name_is_an_identity_with_a_number(tmp_path: Path) -> None:
    path = tmp_path / "name"
    path.write_text("drone-2.7\n")
    assert read_name(path) == "drone-2.7"
    for wrong in ("drone-2", "*.1", "a/b.1", "x.y"):
        path.write_text(wrong)
        with pytest.raises(ConfigError):
            read_name(path)


def test_the_stamp_is_kept_ahead_of_what_was_used(tmp_path: Path) -> None:
    path = tmp_path / "stamp"
    assert StampFile(path).read() == 0
    StampFile(path).store(1_000_000)
    assert StampFile(path).read() == 1_000_000 + 200_000  # two seconds of 10 us
    StampFile(path).store(500_000)
    assert StampFile(path).read() == 1_200_000
    path.write_text("none")
    with pytest.raises(ConfigError, match="rotate the keys"):
        StampFile(path)
