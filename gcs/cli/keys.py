"""`gcs keys`: the lab's keys. Nothing here prints a key."""

import json
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from wire.errors import ConfigError
from wire.files import demand_absent
from wire.process.program import LAB, Json, LabFile, Overwrite, configuration, refusing
from wire.process.system import REJECTED

if TYPE_CHECKING:
    from gcs.security.key_folder import KeyFolder
    from gcs.security.signing_probe import ProbeOutcome

app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None,
    help="Make, carry and revoke the lab's keys, without which no link leaves this machine.",
)  # fmt: skip
Who = Annotated[str, typer.Argument(metavar="NAME", help="An identity, as `gcs keys list` names it: drone-2.")]
Lab = Annotated[Path, typer.Option("--lab", help="The lab file.")]


@app.command()
def new(lab: LabFile, as_json: Json = False) -> None:
    """Make the lab's keys: those that are missing, for its programs, drones and operators."""
    with refusing():
        folder = _folder(lab)
        made = folder.make(_now())
    table = "" if configuration(lab).security is not None else "; now write [security] into the lab file"
    _print(as_json, {"made": made, "keys": str(folder.path)}, f"keys of {_list(made)} in {folder.path}{table}")


@app.command()
def pack(
    who: Who,
    lab: Lab = LAB,
    out: Annotated[Path | None, typer.Option(help="The file; NAME.keys if not given.")] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write one file that carries an identity's keys to another computer. Delete it once it is installed there."""
    from gcs.security.bundle import write_bundle

    path = out or Path(f"{who}.keys")
    with refusing():
        demand_absent(path, overwrite)
        write_bundle(path, who, _folder(lab).files(who, _now()))
    _print(as_json, {"file": str(path)}, f"{path}: carry it to the computer of {who}, and run `gcs keys install` there")


@app.command()
def token(
    who: Who,
    lab: Lab = LAB,
    out: Annotated[Path | None, typer.Option(help="The file; NAME.token if not given.")] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Write the token by which an operator logs in on the page from another computer; an older one is void."""
    from wire.security.private_keys import write_private

    path = out or Path(f"{who}.token")
    with refusing():
        demand_absent(path, overwrite)  # before the older token is void
        write_private(path, f"{_folder(lab).page_token(who, _now())}\n".encode())
    _print(as_json, {"file": str(path)}, f"{path}: carry it to {who}, and delete it once it is in a password manager")


@app.command()
def install(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What `gcs keys pack` wrote.")],
    keys: Annotated[Path, typer.Option(help="Folder to install into.")] = Path("keys"),
    sysid: Annotated[int | None, typer.Option(min=1, max=250, help="The drone that the keys must be of.")] = None,
    serial: Annotated[
        str | None, typer.Option(metavar="DEV:BAUD", help="Give the signing key to the autopilot on this line, too.")
    ] = None,
    overwrite: Overwrite = False,
    as_json: Json = False,
) -> None:
    """Install the keys of one identity on this computer, and with --serial in its autopilot."""
    from formation.exposure import drone_identity
    from gcs.security.bundle import bundle_identity, install_bundle

    outcome = None
    with refusing():
        identity = bundle_identity(file)
        if sysid is not None and identity != drone_identity(sysid):
            raise ConfigError([f"{file}: keys of {identity}, not of drone {sysid}"])
        install_bundle(file, keys, overwrite)
        if serial is not None:
            from gcs.security.autopilot_key import send_key

            outcome = send_key(keys / identity, serial)
    values: dict[str, object] = {"identity": identity, "keys": str(keys)}
    text = f"keys of {identity} in {keys}: delete {file}"
    if outcome is not None:
        values |= {"autopilot_has_key": outcome.has_key, "demands_signatures": outcome.demands_signatures}
        text += f"\n{_proof(outcome)}"
    _print(as_json, values, text)
    if outcome is not None and not outcome.has_key:
        raise typer.Exit(REJECTED)


def _proof(outcome: "ProbeOutcome") -> str:
    """The autopilot's answer after it was given its key, in words."""
    if outcome.demands_signatures:
        return "the autopilot has its key: it obeys what is signed, and nothing that is not"
    if outcome.has_key:
        return (
            "the autopilot has its key, and obeys unsigned commands on this line all the same, as ArduPilot does on "
            "its first serial port (USB): ask `gcs doctor` about a link over a network"
        )
    return "the autopilot did NOT take its key: it answers nothing that the key has signed. Is it disarmed?"


@app.command("list")
def list_keys(lab: LabFile, as_json: Json = False) -> None:
    """List the identities with role, certificate and the day it ends."""
    with refusing():
        held = list(_folder(lab).held())
    rows = [
        {
            "identity": each.identity, "role": each.role, "certificate": each.name,
            "expires": f"{each.expires:%Y-%m-%d}", "revoked": each.revoked,
        }
        for each in held
    ]  # fmt: skip
    lines = [
        f"{each.identity:<16} {each.role:<9} {each.name:<18} "
        + ("revoked" if each.revoked else f"until {each.expires:%Y-%m-%d}")
        for each in held
    ]
    _print(as_json, {"keys": rows}, "\n".join(lines) or "no keys: run `gcs keys new`")


@app.command()
def check(lab: LabFile, as_json: Json = False) -> None:
    """Check modes, ends and rules of the keys. Exit code 1 where something is wrong."""
    with refusing():
        faults = list(_folder(lab).faults(_now()))
    _print(as_json, {"faults": faults}, "\n".join(faults) or "every key is right")
    if faults:
        raise typer.Exit(REJECTED)


@app.command()
def rotate(who: Who, lab: Lab = LAB, as_json: Json = False) -> None:
    """Replace an identity's keys. Its old ones are void where the new rules are: pack and install it again."""
    with refusing():
        name = _folder(lab).rotate(who, _now())
    _print(as_json, {"certificate": name}, f"{name}: {_AFTER}")


@app.command()
def revoke(who: Who, lab: Lab = LAB, as_json: Json = False) -> None:
    """Let nobody in by an identity's keys any more."""
    with refusing():
        name = _folder(lab).revoke(who, _now())
    _print(as_json, {"certificate": name}, f"{name} is revoked: {_REVOKED}")


_REVOKED = "within a second nothing of it is read here; other computers know from the next `gcs keys pack`"
_AFTER = "restart the lab's programs here; other computers have their rules from the next `gcs keys pack`"


def _folder(lab: Path) -> "KeyFolder":
    from gcs.security.key_folder import KeyFolder

    return KeyFolder(configuration(lab), lab)


def _now() -> datetime:
    return datetime.now(UTC)


def _list(names: list[str]) -> str:
    return ", ".join(names) or "nobody new"


def _print(as_json: bool, values: dict[str, object], text: str) -> None:
    print(json.dumps(values) if as_json else text)
