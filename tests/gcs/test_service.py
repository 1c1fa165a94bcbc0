"""The units that `gcs service install` writes: what they start runs where they let it, and reports to its manager."""

import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from numba import config
from typer.testing import CliRunner

from gcs.cli.app import app
from tests.gcs.bus import a_lab
from wire.config_file import dump

NEW_MOUNTS = ["unshare", "--mount", *(["--map-root-user"] if os.getuid() else [])]
"""Everything read-only, as ProtectSystem=strict has it, but the folders given: a unit's state and cache."""
READ_ONLY = 'for d in "$@"; do mount --bind "$d" "$d"; done; mount --bind / / && mount -o remount,bind,ro /'
can_mount = subprocess.run([*NEW_MOUNTS, "sh", "-c", READ_ONLY], capture_output=True, check=False).returncode == 0


@pytest.fixture
def units(tmp_path: Path) -> dict[str, str]:
    """Of a lab with cameras, by name: the ground's, the mocap process's, and that of the bridge of `left`."""
    lab = tmp_path / "my lab.toml"
    lab.write_text(dump(a_lab()), encoding="utf-8")
    written = []
    for further in ((), ("--bridge", "left=udpin:127.0.0.1:14999")):
        options = ["service", "install", str(lab), "--user", "root", "--to", str(tmp_path), "--json", *further]
        written += json.loads(CliRunner().invoke(app, options).stdout)["units"]
    return {
        Path(unit).name.split(".")[0].removeprefix("mavlink-formation-"): Path(unit).read_text() for unit in written
    }


@contextmanager
def manager(folder: Path) -> Iterator[socket.socket]:
    """The socket that a service manager listens at."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        listener.bind(str(folder / "notify"))
        listener.settimeout(120.0)
        yield listener


@pytest.mark.processes
@pytest.mark.skipif(not can_mount, reason="no file system can be mounted here")
@pytest.mark.parametrize(
    ("name", "awaited"),
    [
        ("mocap", {"READY=1", "WATCHDOG=1"}),
        ("bridge-left", {"READY=1", "WATCHDOG=1", "STATUS=waiting for "}),
        ("ground", {"WATCHDOG=1", "STATUS=waiting for "}),
    ],
)
def test_a_unit_runs_in_a_read_only_system_without_a_home(
    units: dict[str, str], tmp_path: Path, name: str, awaited: set[str]
) -> None:
    (command,) = re.findall(r"^ExecStart=(.*)", units[name], re.MULTILINE)
    cache = Path(config.CACHE_DIR).parent  # as compiled before: a unit's own is filled at its first start
    with manager(tmp_path) as listener:
        env = {"PATH": os.environ["PATH"], "NUMBA_CACHE_DIR": str(cache), "NOTIFY_SOCKET": str(tmp_path / "notify")}
        script = f'{READ_ONLY}; cd "$1" && exec {command}'
        shell = [*NEW_MOUNTS, "sh", "-c", script, "sh", str(tmp_path), str(cache)]
        process = subprocess.Popen(shell, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        missing = set(awaited)
        try:
            while missing:
                said = listener.recv(1000).decode()
                missing -= {text for text in missing if said.startswith(text)}
        except TimeoutError:
            process.kill()
            pytest.fail(f"{missing} not said: {process.communicate()[0]}")
        process.send_signal(signal.SIGTERM)
        output, _ = process.communicate(timeout=60.0)
    assert process.returncode == 0, output


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
def test_systemd_accepts_the_units(units: dict[str, str], tmp_path: Path) -> None:
    for file in tmp_path.glob("*.service"):
        done = subprocess.run(["systemd-analyze", "verify", str(file)], capture_output=True, text=True, check=False)
        assert (done.returncode, [line for line in done.stderr.splitlines() if file.stem in line]) == (0, [])


def test_only_the_ground_waits_for_a_person(units: dict[str, str]) -> None:
    assert {name for name, text in units.items() if "WantedBy=" not in text} == {"ground"}
    assert {name for name, text in units.items() if "Restart=on-failure" in text} == {"mocap", "bridge-left"}


def test_a_path_is_one_word(units: dict[str, str], tmp_path: Path) -> None:
    for text in units.values():
        (command,) = re.findall(r"^ExecStart=(.*)", text, re.MULTILINE)
        assert str(tmp_path / "my lab.toml") in shlex.split(command)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--user", "nosuchuser"), "--user: this computer has no user 'nosuchuser'"),
        (("--user", "rot"), "is root meant?"),
        (("--user", "4294967290"), "has no user '4294967290'"),
        (("--bridge", "left"), "--bridge: left=: BODY=serial:DEV:BAUD"),
        (("--bridge", "left=seriall:/dev/x"), "BODY=udp:HOST:PORT"),
        (("--bridge", "left=udp:127.0.0.1:70000"), "BODY=udpin:HOST:PORT is wanted"),
        (("--bridge", "lefft=udp:127.0.0.1:14999"), "none of the lab's drones is 'lefft': is left meant?"),
        ((), "who has no name here: say with --user"),
    ],
)
def test_what_could_never_start_is_not_written(
    options: tuple[str, ...], told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lab, units = tmp_path / "lab.toml", tmp_path / "units"
    units.mkdir()
    lab.write_text(dump(a_lab()), encoding="utf-8")
    if not options:
        monkeypatch.setattr("pwd.getpwuid", lambda _uid: {}["nobody"])
        if os.getuid() == 0:
            os.chown(lab, 20417, -1)
    user = () if not options or "--user" in options else ("--user", "root")
    done = CliRunner().invoke(app, ["service", "install", str(lab), "--to", str(units), *user, *options])
    assert done.exit_code == 2
    assert told in done.output
    assert not list(units.iterdir())
