"""Keys from new to revoked by the command line; openssl judges the certificates."""

import json
import re
import subprocess
from datetime import timedelta
from pathlib import Path

import pytest
import tomli_w
from typer.testing import CliRunner

from drone_agent.guard.config import GuardConfig
from drone_agent.process import drone_protection
from formation.config import LabConfig
from formation.requests import OperatorRequest, Verb
from gcs.cli.app import app
from gcs.security import autopilot_key
from gcs.security.key_folder import KeyFolder
from gcs.security.roles import role_reject_reason
from tests.gcs.security.autopilot import Autopilot, on_a_line
from tests.gcs.security.lab import LAB, NOW, OPERATORS, keyed_lab
from wire.errors import ConfigError
from wire.mavlink.signing import stamp_at
from wire.security.protection import protection_of

RUNNER = CliRunner()


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A lab file with new keys in a folder of its own, which is the working folder."""
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "lab.toml"
    path.write_text(tomli_w.dumps(LAB))
    gcs("new", "lab.toml")
    return path


def gcs(*words: str, code: int = 0) -> str:
    """The output of a command line, which must end with that code."""
    result = RUNNER.invoke(app, ["keys", *words])
    assert result.exit_code == code, result.output
    return result.output


def secrets_in(keys: Path) -> set[str]:
    """Every private line of the folder: keys, and the lines of private PEM files."""
    found = set()
    for path in keys.rglob("*"):
        if path.suffix == ".key" or path.name in ("private.pem", "authority.pem"):
            found |= {line for line in path.read_text().splitlines() if len(line) > 16 and "-----" not in line}
    return found


def openssl(*words: str) -> str:
    return subprocess.run(["openssl", *words], capture_output=True, text=True, check=True).stdout


def test_from_new_to_revoked(lab: Path) -> None:
    said = gcs("new", "lab.toml")
    assert gcs("check", "lab.toml") == "every key is right\n"
    said += gcs("pack", "drone-2")
    elsewhere = lab.parent / "companion"
    said += gcs("install", "drone-2.keys", "--keys", str(elsewhere), "--sysid", "2")
    protection = protection_of(elsewhere, "drone-2")
    assert protection.signing is not None
    assert protection.channel(2) is not None
    assert protection.channel(3) is None
    said += gcs("rotate", "drone-2") + gcs("revoke", "board") + gcs("list", "lab.toml") + gcs("check", "lab.toml")
    listed = {each["identity"]: each for each in json.loads(gcs("list", "lab.toml", "--json"))["keys"]}
    assert listed["drone-2"]["certificate"] == "drone-2.2"
    assert listed["board"]["revoked"]
    assert listed["judge"]["role"] == "safety"
    rules = json.loads((lab.parent / "keys" / "ground" / "access.json").read_text())
    names = {name for subject in rules["subjects"] for name in subject.get("cert_common_names", ())}
    assert "drone-2.2" in names
    assert not {"drone-2.1", "board.1"} & names
    assert protection_of(lab.parent / "keys", "ground").channel(1) is not None
    gcs("revoke", "drone-2")
    assert protection_of(lab.parent / "keys", "ground").channel(2) is None
    assert "board" in gcs("pack", "board", code=2)
    operations = (lab.parent / "keys" / "operations.log").read_text()
    done = [line.split(" ", 2)[2] for line in operations.splitlines()]
    assert done[-3:] == ["rotate drone-2.2", "revoke board.1", "revoke drone-2.2"]
    assert not any(secret in said + operations for secret in secrets_in(lab.parent / "keys"))
    for path in (lab.parent / "keys", *(lab.parent / "keys").rglob("*"), lab.parent / "drone-2.keys"):
        assert path.stat().st_mode & 0o777 == (0o700 if path.is_dir() else 0o600), path


def test_openssl_accepts_the_certificates_and_none_of_another_lab(lab: Path, tmp_path: Path) -> None:
    keys = lab.parent / "keys"
    for identity in ("ground", "drone-2", "anna"):
        own = keys / identity
        certificate = str(own / "certificate.pem")
        assert ": OK" in openssl("verify", "-x509_strict", "-CAfile", str(keys / "ca.pem"), certificate)
        text = openssl("x509", "-in", certificate, "-noout", "-text")
        assert re.search(rf"Subject: CN ?= ?{identity}\.1\n", text)
        assert "TLS Web Server Authentication, TLS Web Client Authentication" in text
        assert "CA:FALSE" in text
        public = openssl("x509", "-in", certificate, "-noout", "-pubkey")
        assert openssl("pkey", "-in", str(own / "private.pem"), "-pubout") == public
    keyed_lab(tmp_path / "other")
    theirs = str(tmp_path / "other" / "keys" / "ground" / "certificate.pem")
    with pytest.raises(subprocess.CalledProcessError):
        openssl("verify", "-CAfile", str(keys / "ca.pem"), theirs)


def test_new_adds_what_is_missing_and_keeps_the_rest(lab: Path) -> None:
    before = (lab.parent / "keys" / "drone-2" / "private.pem").read_bytes()
    more = LAB | {"followers": [*LAB["followers"], {"body": "back", "sysid": 9, "offset_m": [-1.0, 0.0, 0.0]}]}
    lab.write_text(tomli_w.dumps(more))
    assert "drone-9: no keys" in gcs("check", "lab.toml", code=1)
    assert json.loads(gcs("new", "lab.toml", "--json"))["made"] == ["drone-9"]
    assert (lab.parent / "keys" / "drone-2" / "private.pem").read_bytes() == before
    gcs("check", "lab.toml")
    lab.write_text(tomli_w.dumps(more | {"security": {"operators": OPERATORS, "addresses": ["192.0.2.20"]}}))
    gcs("new", "lab.toml")  # an address that the lab gets later is in new certificates
    names = {each["identity"]: each["certificate"] for each in json.loads(gcs("list", "lab.toml", "--json"))["keys"]}
    assert (names["ground"], names["drone-2"]) == ("ground.2", "drone-2.1")
    gcs("check", "lab.toml")


def test_the_keys_of_drones_differ_and_the_ground_has_each(lab: Path) -> None:
    keys = lab.parent / "keys"
    own = [(keys / f"drone-{n}" / f"mavlink-{n}.key").read_text() for n in (1, 2, 3)]
    assert own == [(keys / "ground" / f"mavlink-{n}.key").read_text() for n in (1, 2, 3)]
    inner = [(keys / f"drone-{n}" / "autopilot.key").read_text() for n in (1, 2, 3)]
    assert len({*own, *inner}) == 6
    assert not list((keys / "ground").glob("autopilot.key"))


def test_an_end_is_foreseen_and_an_ended_certificate_is_a_fault(tmp_path: Path) -> None:
    config = LabConfig.model_validate(LAB)
    folder = KeyFolder(config, tmp_path / "lab.toml")
    folder.make(NOW)
    assert list(folder.faults(NOW)) == []
    assert all("expires on 2027-11-25" in fault for fault in folder.faults(NOW + timedelta(days=350)))
    assert len(list(folder.faults(NOW + timedelta(days=366)))) == 10


def test_loose_modes_are_a_fault_and_keep_a_program_from_starting(lab: Path) -> None:
    path = lab.parent / "keys" / "ground" / "private.pem"
    path.chmod(0o644)
    assert "open to others" in gcs("check", "lab.toml", code=1)
    with pytest.raises(ConfigError, match="open to others"):
        protection_of(lab.parent / "keys", "ground")


@pytest.mark.parametrize(
    ("name", "text", "fault"),
    [
        ("private.pem", "x", "PEM"),
        ("private.pem", "of drone-1", "the private key is not the certificate's"),
        ("certificate.pem", "of drone-1", "the private key is not the certificate's"),
        ("name", "drone-1.1", "not one of drone-2"),
        ("name", "drone-2.7", "another name"),
        ("access.json", "[" * 100_000, "nested deeper"),
        ("mavlink-2.key", "x", "hexadecimal digits"),
        ("mavlink-2.key", None, "no signing key of drone-2"),
        ("name", "\ud800", "not a file of `gcs keys pack`"),
        ("../../evil", "x", "not a file of `gcs keys pack`"),
        ("/etc/passwd", "x", "not a file of `gcs keys pack`"),
        ("mavlink-1.key/..", "x", "not a file of `gcs keys pack`"),
        ("stamp", "0", "not a file of `gcs keys pack`"),
        ("a", 1, "not a file of `gcs keys pack`"),
    ],
)
def test_a_bundle_with_one_false_file_installs_nothing_and_leaves_good_keys(
    name: str, text: object, fault: str, lab: Path
) -> None:
    gcs("pack", "drone-2")
    gcs("install", "drone-2.keys", "--keys", "there")
    before = {path: path.read_bytes() for path in Path("there").rglob("*.*")}
    bundle = json.loads(Path("drone-2.keys").read_text())
    bundle["files"].pop(name, None)
    if text is not None:
        own = lab.parent / "keys" / "drone-1" / name
        bundle["files"][name] = own.read_text() if text == "of drone-1" else text
    Path("drone-2.keys").write_text(json.dumps(bundle))
    for folder in ("there", "elsewhere"):
        assert fault in gcs("install", "drone-2.keys", "--keys", folder, code=2)
    assert {path: path.read_bytes() for path in Path("there").rglob("*.*")} == before
    assert not Path("elsewhere").exists()


def test_a_drone_without_its_signing_key_does_not_start_and_is_a_fault(lab: Path) -> None:
    (lab.parent / "keys" / "drone-2" / "mavlink-2.key").unlink()
    with pytest.raises(ConfigError, match=r"mavlink-2.key: no signing key"):
        _ = drone_protection(GuardConfig(sysid=2, keys=lab.parent / "keys"))
    assert "drone-2 has no signing key" in gcs("check", "lab.toml", code=1)


def test_new_keys_begin_new_stamps(lab: Path) -> None:
    """A drone whose stolen key has sent a stamp of next year is a drone again with its next key."""
    keys = lab.parent / "keys"
    stolen = protection_of(keys, "drone-2").signing
    assert stolen is not None
    stolen.stamps.store(stamp_at(1_900_000_000_000_000))
    gcs("rotate", "drone-2")
    mended = protection_of(keys, "drone-2").signing
    assert mended is not None
    assert mended.clock.floor == 0


def install_over(line: str, *more: str, code: int = 0) -> str:
    """The output of an installation over a serial line."""
    words = "install", "drone-2.keys", "--keys", "there", "--sysid", "2", "--serial", f"{line}:57600"
    return gcs(*words, *more, code=code)


def test_the_autopilot_is_given_its_key_over_a_serial_line_and_proves_it(lab: Path) -> None:
    """pymavlink reads what comes over the line; behind a bridge it is the inner key, not the network's."""
    gcs("pack", "drone-2")
    autopilot = Autopilot(None)
    with on_a_line(autopilot) as line:
        said = install_over(line)
    (first, *_) = autopilot.received
    assert bytes(first.secret_key).hex() == Path("there/drone-2/autopilot.key").read_text()
    assert (first.target_system, first.target_component) == (2, 1)
    assert first.initial_timestamp > 0
    assert "it obeys what is signed, and nothing that is not" in said
    assert Path("there/drone-2/autopilot-installed.key").read_text() == Path("there/drone-2/autopilot.key").read_text()
    assert protection_of(Path("there"), "drone-2").autopilot_has_key
    assert "keys of drone-2, not of drone 1" in gcs("install", "drone-2.keys", "--sysid", "1", code=2)
    Path("drone-2.keys").chmod(0o644)
    assert "open to others" in gcs("install", "drone-2.keys", code=2)


def test_an_autopilot_with_a_key_takes_the_next_one_from_a_packet_that_the_old_one_signs(lab: Path) -> None:
    gcs("pack", "drone-2")
    autopilot = Autopilot(None)
    with on_a_line(autopilot) as line:
        install_over(line)
        gcs("rotate", "drone-2")
        assert "--overwrite writes over it" in gcs("pack", "drone-2", code=2)
        gcs("pack", "drone-2", "--overwrite")
        assert "--overwrite writes over it" in install_over(line, code=2)
        said = install_over(line, "--overwrite")
    assert "it obeys what is signed, and nothing that is not" in said
    keys = {bytes(message.secret_key) for message in autopilot.received}
    assert len(keys) == 2


@pytest.mark.parametrize(
    ("autopilot", "takes_keys", "code", "words"),
    [
        (Autopilot(None, make=3, trusts=True), True, 0, "obeys unsigned commands on this line all the same"),
        (Autopilot(None), False, 1, "did NOT take its key"),  # as an ArduPilot that is armed
        (Autopilot(None, system=3), True, 1, "no autopilot of system 2 speaks there; no key was sent"),
    ],
    ids=["a trusted line", "not taken", "another system"],
)
def test_a_key_that_protects_nothing_is_no_success(
    autopilot: Autopilot, takes_keys: bool, code: int, words: str, lab: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bridge does not sign either with a key that was not taken; none is sent where another system speaks."""
    monkeypatch.setattr(autopilot_key, "PRESENT_S", 0.2 if "no autopilot" in words else 5.0)
    autopilot.takes_keys = takes_keys
    gcs("pack", "drone-2")
    with on_a_line(autopilot) as line:
        assert words in install_over(line, code=code)
    assert protection_of(Path("there"), "drone-2").autopilot_has_key is (code == 0)
    assert bool(autopilot.received) is (code == 0)


@pytest.mark.parametrize(
    ("name", "allowed"),
    [
        ("tool.1", set(Verb)),
        ("page.4", set(Verb)),
        ("anna.1", set(Verb)),
        ("board.2", {Verb.STATUS, Verb.STOP}),
        ("judge.1", {Verb.STATUS, Verb.STOP, Verb.HOLD, Verb.LAND, Verb.ACKNOWLEDGE}),
        ("drone-1.1", set()),
        ("mocap.1", set()),
        ("nobody.1", set()),
        ("board", set()),
        ("", set()),
    ],
)
def test_each_role_may_ask_for_its_own(name: str, allowed: set[Verb]) -> None:
    config = LabConfig.model_validate(LAB)
    found = {v for v in Verb if not role_reject_reason(config, OperatorRequest(1, v, source=f"{name} (anna@page.1)"))}
    assert found == allowed
