"""A lab's folder of keys on the computer where they are made: everything in it, and what is changed (layout:
`wire.security.private_keys`). A name in a certificate is an identity with a number; a new certificate has the next one,
and the rules let nobody in by an older.

The rules are Zenoh's access control, made of the lab file. Everything is denied that no rule allows. Each process
enforces the rules on what it receives, by the name in the sender's certificate. Everybody who has keys may subscribe;
what may be published, asked and answered goes by identity.
"""

import json
import secrets
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from formation.config import LabConfig
from formation.exposure import GROUND, MOCAP, OWN_IDENTITIES, PAGE, TOOL, drone_identity, endpoint_host, numbered
from formation.names import unknown
from formation.security_config import SecurityConfig
from gcs.security.certificates import KeyPair, common_name, expiry, hosts_in, new_authority, new_identity
from gcs.security.page_logins import drop_token, new_token
from wire.errors import ConfigError
from wire.files import make_folder
from wire.process.system import own_name
from wire.security.private_keys import (
    ACCESS,
    AUTHORITY,
    AUTOPILOT,
    CERTIFICATE,
    KEY_BYTES,
    NAME,
    PRIVATE,
    REVOKED_NAMES,
    STOP_KEY,
    demand_private,
    demand_private_tree,
    keys_folder,
    mavlink_key_file,
    note_operation,
    read_access,
    read_name,
    read_revoked,
    stop_key_file,
    write_private,
)

AUTHORITY_PRIVATE, REVOKED = "authority.pem", "revoked"
EXPIRES_SOON = timedelta(days=30)


@dataclass(frozen=True, slots=True)
class IdentityKeys:
    """One identity's keys as they are: its role, the name and the end of its certificate, whether it is revoked."""

    identity: str
    role: str
    name: str
    expires: datetime
    revoked: bool


class KeyFolder:
    """The keys of one lab. Raises ConfigError for keys that are missing, not private, or not as the lab file has it."""

    def __init__(self, config: LabConfig, lab_file: Path) -> None:
        self._config = config
        self._security = config.security or SecurityConfig()
        self.path = keys_folder(self._security.keys, lab_file)

    def make(self, now: datetime) -> list[str]:
        """Make what is missing, and the rules anew; return the identities that were made. OSError."""
        make_folder(self.path)
        demand_private(self.path)
        if not (self.path / AUTHORITY_PRIVATE).exists():
            authority = new_authority(self._config.name, now)
            write_private(self.path / AUTHORITY_PRIVATE, authority.private)
            write_private(self.path / AUTHORITY, authority.certificate)
        made = [identity for identity in identities(self._config) if not (self.path / identity / NAME).exists()]
        for identity in made:
            self._issue(identity, 1, now)
        moved = [identity for identity in OWN_IDENTITIES if self._lacks_hosts(identity)]
        for identity in moved:
            self._issue(identity, self._number(identity) + 1, now)
        made += moved
        self._write_rules()
        self._note(now, f"new {', '.join(made) or 'rules'}")
        return made

    def rotate(self, identity: str, now: datetime) -> str:
        """Replace an identity's keys, revoked ones too; return the new certificate's name."""
        number = self._number(identity) + 1
        self._issue(identity, number, now)
        (self.path / identity / REVOKED).unlink(missing_ok=True)
        self._write_rules()
        self._note(now, f"rotate {numbered(identity, number)}")
        return numbered(identity, number)

    def revoke(self, identity: str, now: datetime) -> str:
        """Let nobody in by an identity's keys any more; return the certificate's name."""
        name = self._name(identity)
        write_private(self.path / identity / REVOKED, b"")
        own = {numbered(identity, number + 1) for number in range(self._number(identity))}
        write_private(self.path / REVOKED_NAMES, "\n".join(sorted(read_revoked(self.path) | own)).encode())
        for key in self._mavlink_keys(identity):
            key.unlink(missing_ok=True)
        self._drop_stop_keys(identity)
        drop_token(self.path / PAGE, identity)
        self._write_rules()
        self._note(now, f"revoke {name}")
        return name

    def page_token(self, operator: str, now: datetime) -> str:
        """A new token by which an operator logs in on the page from another machine; an older one is void."""
        if operator not in self._security.operators:
            raise ConfigError([f"[security] operators: no operator {unknown(operator, self._security.operators)}"])
        if (self.path / operator / REVOKED).exists():
            raise ConfigError([f"{operator}: revoked: `gcs keys rotate` makes new keys"])
        demand_private_tree(self.path / PAGE)
        token = new_token(self.path / PAGE, operator)
        self._note(now, f"token {operator}")
        return token

    def files(self, identity: str, now: datetime) -> dict[str, str]:
        """The files by which another computer is this identity: their texts, by their names."""
        name = self._name(identity)
        own = self.path / identity
        demand_private_tree(own)
        if (own / REVOKED).exists():
            raise ConfigError([f"{own}: revoked: `gcs keys rotate` makes new keys"])
        wanted = (AUTHORITY, CERTIFICATE, PRIVATE, NAME, ACCESS, AUTOPILOT, REVOKED_NAMES, STOP_KEY)
        self._note(now, f"pack {name}")
        found = [*(own / name for name in wanted), *sorted(own.glob("mavlink-*.key"))]
        return {path.name: path.read_text(encoding="ascii") for path in found if path.exists()}

    def held(self) -> Iterator[IdentityKeys]:
        """Every identity of the lab that has keys."""
        for identity in identities(self._config):
            own = self.path / identity
            if (own / NAME).exists():
                role = self._security.role_of(identity)
                certificate = (own / CERTIFICATE).read_bytes()
                yield IdentityKeys(
                    identity, role or "-", read_name(own / NAME), expiry(certificate), (own / REVOKED).exists()
                )  # fmt: skip

    def faults(self, now: datetime) -> Iterator[str]:
        """The faults of the keys, a line each."""
        try:
            demand_private_tree(self.path)
        except ConfigError as error:
            yield str(error)
            return
        held = {each.identity: each for each in self.held()}
        for identity in identities(self._config):
            if identity not in held:
                yield f"{identity}: no keys: run `gcs keys new`"
        for each in held.values():
            own = self.path / each.identity
            if each.expires <= now:
                yield f"{each.identity}: expired on {each.expires:%Y-%m-%d}: run `gcs keys rotate {each.identity}`"
            elif each.expires - now < EXPIRES_SOON:
                yield f"{each.identity}: expires on {each.expires:%Y-%m-%d}: run `gcs keys rotate {each.identity}`"
            if common_name((own / CERTIFICATE).read_bytes()) != each.name:
                yield f"{each.identity}: its certificate is of another name"
            if each.identity in OWN_IDENTITIES and self._lacks_hosts(each.identity):
                yield f"{each.identity}: its certificate lacks an address of the lab file: run `gcs keys new`"
            if read_access(own) != self._rules():
                yield f"{each.identity}: its rules are not those of the lab file: run `gcs keys new`"
        for vehicle in self._config.vehicles:
            drone = None if vehicle.sysid is None else held.get(drone_identity(vehicle.sysid))
            if drone is None or drone.revoked:
                continue
            for holder, key in zip((drone.identity, GROUND), self._mavlink_keys(drone.identity), strict=True):
                if not key.exists():
                    yield f"{drone.identity}: {holder} has no signing key: run `gcs keys rotate {drone.identity}`"

    def _issue(self, identity: str, number: int, now: datetime) -> None:
        """A new certificate, and for a drone new keys of signing, which the ground has, too."""
        own = self.path / identity
        make_folder(own)
        authority = self._authority()
        issued = new_identity(authority, numbered(identity, number), self._hosts(), now)
        write_private(own / AUTHORITY, authority.certificate)
        write_private(own / CERTIFICATE, issued.certificate)
        write_private(own / PRIVATE, issued.private)
        key = secrets.token_hex(KEY_BYTES).encode()
        for path in self._mavlink_keys(identity):
            make_folder(path.parent)
            write_private(path, key)
        self._drop_stop_keys(identity)
        if self._security.role_of(identity) is not None:
            make_folder(self.path / GROUND)
            stop_key = secrets.token_hex(KEY_BYTES).encode()
            write_private(own / STOP_KEY, stop_key)
            write_private(self.path / GROUND / stop_key_file(numbered(identity, number)), stop_key)
        if identity in self._bridged():
            write_private(own / AUTOPILOT, secrets.token_hex(KEY_BYTES).encode())
        write_private(own / NAME, numbered(identity, number).encode())

    def _drop_stop_keys(self, identity: str) -> None:
        """The ground's, of every certificate that the identity has had."""
        for path in (self.path / GROUND).glob(stop_key_file(f"{identity}.*")):
            if path.stem.removeprefix(f"stop-{identity}.").isdecimal():
                path.unlink()

    def _note(self, now: datetime, what: str) -> None:
        note_operation(self.path, f"{now:%Y-%m-%dT%H:%M:%SZ} {own_name()} {what}")

    def _write_rules(self) -> None:
        rules = json.dumps(self._rules(), indent=1).encode()
        revoked = "\n".join(sorted(read_revoked(self.path))).encode()
        for each in self.held():
            write_private(self.path / each.identity / ACCESS, rules)
            write_private(self.path / each.identity / REVOKED_NAMES, revoked)

    def _rules(self) -> dict[str, object]:
        return access_control(self._config, {each.identity: each.name for each in self.held() if not each.revoked})

    def _name(self, identity: str) -> str:
        if identity not in identities(self._config):
            raise ConfigError([f"no identity {unknown(identity, identities(self._config))}"])
        return read_name(self.path / identity / NAME)

    def _number(self, identity: str) -> int:
        return int(self._name(identity).rpartition(".")[2])

    def _lacks_hosts(self, identity: str) -> bool:
        """Whether the lab has an address by now that the identity's certificate does not name."""
        return not set(self._hosts()) <= hosts_in((self.path / identity / CERTIFICATE).read_bytes())

    def _authority(self) -> KeyPair:
        demand_private(self.path / AUTHORITY_PRIVATE)
        return KeyPair((self.path / AUTHORITY).read_bytes(), (self.path / AUTHORITY_PRIVATE).read_bytes())

    def _hosts(self) -> tuple[str, ...]:
        """The names by which others connect to a process of the lab."""
        link = self._config.link
        named = (endpoint_host(endpoint) for endpoint in (*link.zenoh_listen, *link.zenoh_connect))
        own = ("localhost", "127.0.0.1", "::1", *self._security.addresses)
        return tuple(dict.fromkeys((*own, *(host for host in named if host not in ("", "0.0.0.0", "::")))))

    def _mavlink_keys(self, identity: str) -> tuple[Path, ...]:
        """The files that hold a drone's signing key, here and at the ground; none for others."""
        if not identity.startswith("drone-"):
            return ()
        name = mavlink_key_file(int(identity.removeprefix("drone-")))
        return self.path / identity / name, self.path / GROUND / name

    def _bridged(self) -> tuple[str, ...]:
        """Drones that a bridge stands beside: those without a link of their own."""
        return tuple(drone_identity(v.sysid) for v in self._config.vehicles if v.sysid is not None and v.link is None)


_PUBLISH, _ALIVE, _ASK = ("put",), ("liveliness_token",), ("query",)
_ANSWER = ("declare_queryable", "reply")
_LISTEN = ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query")
_ALL = (*_PUBLISH, "delete", *_ALIVE, *_ASK, *_ANSWER, *_LISTEN)
_EVERYBODY = "everybody"


def identities(config: LabConfig) -> tuple[str, ...]:
    """Everybody who has keys in the lab: its programs, its drones, its operators."""
    drones = (drone_identity(v.sysid) for v in config.vehicles if v.sysid is not None)
    return (*OWN_IDENTITIES, *drones, *(config.security.operators if config.security is not None else ()))


def access_control(config: LabConfig, names: Mapping[str, str]) -> dict[str, Any]:
    """Zenoh's `access_control`. names: the name in the certificate of each identity that is not revoked."""
    rules = [_rule("out", _ALL, ("**",), flow="egress"), _rule("listen", _LISTEN, (f"{config.name}/**",))]
    subjects: list[dict[str, Any]] = [{"id": _EVERYBODY}]
    policies = [{"rules": ["out"], "subjects": [_EVERYBODY]}]
    for identity, name in names.items():
        own = [
            _rule(f"{identity}: {messages[0]}", messages, tuple(f"{config.name}/{key}" for key in keys))
            for messages, keys in _allowed(identity, name)
        ]
        rules += own
        subjects.append({"id": identity, "cert_common_names": [name]})
        policies.append({"rules": ["listen", *(rule["id"] for rule in own)], "subjects": [identity]})
    return {
        "enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies,
    }  # fmt: skip


def _allowed(identity: str, name: str) -> tuple[tuple[tuple[str, ...], tuple[str, ...]], ...]:
    """Kinds of messages of an identity, and their keys below the lab's name.

    What is published carries the name in its publisher's certificate, so that each process knows what of it is revoked.
    """
    asks = (_ASK, (f"gcs/*/do/{name}",))
    if identity == GROUND:
        return (
            (_PUBLISH, ("uav/*/mavlink/down", *(f"gcs/*/{key}/{name}" for key in ("state", "log/head", "log/chunk")))),
            (_ANSWER, ("gcs/*/do/*",)),
            (_ALIVE, ("ground/**",)),
        )
    if identity == MOCAP:
        published = tuple(f"mocap/{key}/{name}" for key in ("frame", "event", "state"))
        return (_PUBLISH, published), (_ALIVE, ("mocap/alive/*",))
    if identity == TOOL:  # a publisher of the lab's own cameras is one, too
        return asks, (_PUBLISH, (f"mocap/raw/{name}",))
    if identity == PAGE or not identity.startswith("drone-"):
        return (asks,)
    sysid = identity.removeprefix("drone-")
    return ((_PUBLISH, (f"uav/{sysid}/mavlink/up", f"sim/{sysid}/truth/{name}")),)


def _rule(name: str, messages: tuple[str, ...], keys: tuple[str, ...], flow: str = "ingress") -> dict[str, Any]:
    return {
        "id": name, "messages": list(messages), "flows": [flow], "permission": "allow", "key_exprs": list(keys),
    }  # fmt: skip
