"""Who may speak to the page's server: what was loaded from it, by a browser on this machine, and nothing else.

Loopback keeps other machines out, not other web pages: a browser lets any page try a WebSocket to 127.0.0.1 (its
`Origin` then tells), or has it believe that its own name leads there (DNS rebinding; its `Host` then tells).
"""

from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import urlsplit

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Server = Callable[[Scope, Receive, Send], Awaitable[None]]
Tell = Callable[[str, str], None]
"""Told whose request was refused, and why."""

# The page's framework puts scripts and styles into the page and compiles its templates there.
POLICY = (
    "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
    "img-src 'self' data:; font-src 'self' data:; object-src 'none'; base-uri 'self'; form-action 'none'; "
    "frame-ancestors 'none'"
)
GUARDS = (
    (b"content-security-policy", POLICY.encode()),
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
)
OUR_NAMES = ("127.0.0.1", "localhost", "::1")


class OwnPagesOnly:
    """A server behind which only requests of the page itself arrive; the others are answered with 403, and told of."""

    def __init__(self, app: Server, tell: Tell) -> None:
        self._app, self._tell = app, tell

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request, or one WebSocket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        send = _guarded(send)
        host, origin = _header(scope, b"host") or "", _header(scope, b"origin")
        against = refusal(host, origin)
        if not against:
            await self._app(scope, receive, send)
            return
        self._tell(host if origin is None else origin, against)
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            await send({"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"text/plain")]})
            await send({"type": "http.response.body", "body": b"refused: " + against.encode()})


def _guarded(send: Send) -> Send:
    """With what tells a browser that no other page may frame this one, and that it loads nothing from elsewhere."""

    async def guarded(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message = {**message, "headers": [*message.get("headers", ()), *GUARDS]}
        await send(message)

    return guarded


def refusal(host: str, origin: str | None) -> str:
    """Why a request for `host` by a page of `origin` is refused; empty where it is ours. None: it names no page.

    The port may be any: one that is forwarded (ssh -L) is another than the server's own.
    """
    if _name(f"//{host}") not in OUR_NAMES:
        return "its host is not this machine by 127.0.0.1 or localhost"
    if origin is not None and origin.lower() != f"http://{host.lower()}":
        return "a page of another origin"
    return ""


def _name(url: str) -> str:
    try:
        return urlsplit(url).hostname or ""
    except ValueError:
        return ""


def _header(scope: Scope, name: bytes) -> str | None:
    """The value of a header, of one that comes twice both, which then is none of ours; None where there is none."""
    found = [value.decode("latin-1") for key, value in scope["headers"] if key.lower() == name]
    return " ".join(found) if found else None
