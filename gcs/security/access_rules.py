"""Who may do what on a lab's bus with keys: Zenoh's access control, made of the lab file. Pure.

Everything is denied that no rule allows. Each process enforces the rules on what it receives, by the name in the
sender's certificate. Everybody who has keys may subscribe; what may be published, asked and answered goes by identity.
"""

from collections.abc import Mapping
from typing import Any

from formation.config import LabConfig
from formation.exposure import GROUND, MOCAP, OWN_IDENTITIES, PAGE, TOOL, drone_identity

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
