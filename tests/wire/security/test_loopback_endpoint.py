"""A hub with keys has a second endpoint, for this machine alone, which its own processes know."""

from pathlib import Path

import pytest

from wire.security.bus_access import LOCAL, BusAccess


def access(folder: Path) -> BusAccess:
    own = folder / "keys" / "ground"
    own.mkdir(parents=True, exist_ok=True)
    return BusAccess(own)


@pytest.mark.parametrize("endpoint", ["tls/0.0.0.0:7447", "tls/127.0.0.1:7447"])
def test_a_hub_with_keys_listens_on_a_port_of_its_own_too(tmp_path: Path, endpoint: str) -> None:
    (opened,) = access(tmp_path).open_loopback([endpoint])
    assert opened.startswith("tls/127.0.0.1:")
    assert BusAccess(tmp_path / "keys" / "tool").loopback() == [opened]
    assert (tmp_path / "keys" / "loopback").stat().st_mode & 0o077 == 0


def test_who_is_no_hub_and_one_without_keys_do_not(tmp_path: Path) -> None:
    assert access(tmp_path).open_loopback([]) == []
    assert LOCAL.open_loopback(["tcp/0.0.0.0:7447"]) == []
    assert access(tmp_path).loopback() == LOCAL.loopback() == []


def test_a_note_of_another_machine_is_not_followed(tmp_path: Path) -> None:
    own = access(tmp_path)
    (tmp_path / "keys" / "loopback").write_text("tls/192.0.2.1:7447")
    assert own.loopback() == []
