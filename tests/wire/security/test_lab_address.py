"""Where a command finds the ground and its keys, with a lab file and without."""

from pathlib import Path

import pytest

from formation.config import LinkConfig
from wire.errors import ConfigError
from wire.transport.lab_address import LabAddress, address_in, address_near

LINK = 'name = "hall"\n[link]\nzenoh_connect = ["tls/192.0.2.1:7447"]\n'


def test_a_file_says_where_the_keys_are(tmp_path: Path) -> None:
    path = tmp_path / "hall.toml"
    path.write_text(LINK)
    assert address_in(path).keys is None
    path.write_text(LINK + "[security]\n")
    assert address_in(path).keys == tmp_path / "keys"
    path.write_text(LINK + '[security]\nkeys = "/etc/lab/keys"\n')
    assert address_in(path).keys == Path("/etc/lab/keys")
    path.write_text(LINK + "[security]\nkeys = 7\n")
    with pytest.raises(ConfigError, match=r"security\.keys"):
        address_in(path)


def test_where_the_ground_listens_is_where_the_others_connect(tmp_path: Path) -> None:
    """Else the stop goes to another port than the ground's."""
    path, here = tmp_path / "lab.toml", "tcp/127.0.0.1:7448"
    path.write_text(f'[link]\nzenoh_listen = ["{here}"]\n')
    assert address_in(path).endpoints == (here,)
    link = LinkConfig(zenoh_listen=(here,))
    assert (link.joined.zenoh_connect, link.zenoh_connect, link.names_bus) == ((here,), (), True)
    router = LinkConfig(zenoh_listen=(here,), zenoh_connect=("tcp/127.0.0.1:7447",))
    assert router.joined.zenoh_connect == ("tcp/127.0.0.1:7447",)  # asked for in so many words


def test_without_a_file_the_lab_here_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert address_near(None) == LabAddress()
    Path("lab.toml").write_text(LINK)
    assert address_near(None) == LabAddress("hall", ("tls/192.0.2.1:7447",))
    Path("lab.toml").write_text(LINK + "[security]\n")
    assert address_near(None) == LabAddress("hall", ("tls/192.0.2.1:7447",), Path("keys"))
    Path("lab.toml").write_text("no TOML")
    assert address_near(None) == LabAddress()
