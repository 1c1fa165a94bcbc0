"""Who may ask the ground for what, in a lab with keys."""

import re
from collections.abc import Callable

from formation.config import LabConfig
from formation.exposure import PAGE, identity_in
from formation.reasons import Reason, Reject
from formation.requests import OperatorReply, OperatorRequest
from formation.security_config import MAY_ASK
from wire.rejections import RejectionLog
from wire.security.protection import Names
from wire.transport.zenoh_bus import Handler, Reply

BEYOND_ROLE = "request that its role may not make"
_VISITOR = re.compile(r"\((\S+) at \S+\)$")


def visitor_source(name: str, address: str) -> str:
    """The source of a request that the page makes for an operator on another machine."""
    return f"{name} at {address}"


def visitor(request: OperatorRequest) -> str:
    """The operator on another machine for whom the page asks; empty where it asks for who sits before it."""
    found = _VISITOR.search(request.source)
    return found[1] if found is not None and identity_in(asker(request)) == PAGE else ""


def asker(request: OperatorRequest) -> str:
    """The name in the certificate of who asks: the bus puts it first in the source."""
    return request.source.partition(" ")[0]


def role_reject_reason(config: LabConfig, request: OperatorRequest) -> Reject | None:
    """Why a request over the bus is rejected by who asks; None where it may be made, and in a lab without keys."""
    if config.security is None:
        return None
    role = config.security.role_of(identity_in(asker(request)))
    if role is None:
        return Reason.NO_ROLE.of(asker(request))
    name, behind = asker(request), visitor(request)
    if behind and request.verb in MAY_ASK[role]:
        name, role = behind, config.security.operators.get(behind)
        if role is None:
            return Reason.NO_ROLE.of(name)
    if request.verb in MAY_ASK[role]:
        return None
    return Reason.BEYOND_ROLE.of(role, name, request.verb.command_name)


def by_role(
    config: LabConfig, handler: Handler, rejections: RejectionLog, now_ns: Callable[[], int], names: Names | None = None
) -> Handler:
    """A handler that hands on what the role of who asks allows, and answers and counts the rest.

    names: of certificates that are not revoked, as they are at the time; None: nobody is asked.
    """

    def handle(request: OperatorRequest, reply: Reply) -> None:
        reject = role_reject_reason(config, request)
        if names is not None and asker(request) not in names.known:
            reject = Reason.KEYS_REVOKED.of(asker(request))
        if reject is None:
            handler(request, reply)
            return
        rejections.note(request.source if visitor(request) else asker(request), BEYOND_ROLE, now_ns())
        reply(OperatorReply(request.id, False, reject.text, (reject.reason.code,)))

    return handle
