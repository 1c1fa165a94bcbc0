"""The systemd units and udev rules that are shipped: systemd reads them, and they start what the programs know."""

import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.docs.manual_pages import ROOT
from tests.docs.test_blocks import parse_ours

UNITS = sorted((ROOT / "contrib" / "systemd").glob("*.service"))
RULES = ROOT / "contrib" / "udev" / "90-mavlink-formation.rules"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="needs systemd-analyze")
@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_systemd_accepts_the_unit(unit: Path, tmp_path: Path) -> None:
    """With a program in the place of ours: systemd wants it to be there."""
    text = re.sub(r"^ExecStart=\S+", "ExecStart=/bin/true", unit.read_text(encoding="utf-8"), flags=re.MULTILINE)
    text = text.replace("User=formation", "User=root")
    copy = tmp_path / unit.name.replace("@.", "@2.")
    copy.write_text(text, encoding="utf-8")
    done = subprocess.run(["systemd-analyze", "verify", str(copy)], capture_output=True, text=True, check=False)
    said = [line for line in done.stderr.splitlines() if unit.name.partition("@")[0].partition(".")[0] in line]
    assert done.returncode == 0, done.stderr
    assert said == []


@pytest.mark.parametrize("unit", UNITS, ids=lambda unit: unit.name)
def test_unit_starts_a_command_that_exists_and_keeps_compiled_kernels_where_it_may_write(unit: Path) -> None:
    (command,) = re.findall(r"^ExecStart=/opt/mavlink-formation/.venv/bin/(.*)", unit.read_text(), re.MULTILINE)
    command = command.replace("%i", "2").replace("${BODY}", "left")
    command = command.replace("${BRIDGE}", "serial:/dev/autopilot:921600").replace("${BUS}", "tcp/192.168.1.20:7447")
    parse_ours(shlex.split(command))
    lines = unit.read_text(encoding="utf-8").splitlines()  # its user has no home, the program's folder is read-only
    assert {"CacheDirectory=mavlink-formation", "Environment=XDG_CACHE_HOME=%C"} <= set(lines)


def test_udev_rules_are_rules() -> None:
    rules = [line for line in RULES.read_text(encoding="utf-8").splitlines() if line and not line.startswith("#")]
    pair = re.compile(r'[A-Z_]+(\{\w+\})?(==|\+=|=)"[^"]*"')
    assert rules
    assert all(pair.fullmatch(part) for rule in rules for part in rule.split(", ")), rules
