"""Who may speak to the page's server: what was loaded from it, by a browser on this machine, and nothing else.

Loopback keeps other machines out, not other web pages: a browser lets any page try a WebSocket to 127.0.0.1 (the
`Origin` header shows it), or pretends that its own name leads there (DNS rebinding; the `Host` header shows it).
"""

import re
from base64 import b64encode
from collections.abc import Awaitable, Callable, Mapping, MutableMapping
from hashlib import sha256
from typing import Any
from urllib.parse import urlsplit

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
Server = Callable[[Scope, Receive, Send], Awaitable[None]]
OnReject = Callable[[str, str], None]
"""Called with the sender of a rejected request, and the reason."""

GUARDS = (
    (b"x-frame-options", b"DENY"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"same-origin"),  # by `no-referrer` a browser hides the origin of a form, too
)
_INLINE = re.compile(rb"<script(?![^>]*\bsrc=)[^>]*>(.*?)</script>", re.DOTALL)
CRLF, LF = b"\r\n", b"\n"  # as a browser reads a document
VISITOR = "formation.visitor"
"""In the scope of a request that came by the door for other machines (`gcs.page.door`), which has checked it: who it is
of. No client can write it."""
OUR_NAMES = ("127.0.0.1", "localhost", "::1")


class OwnPagesOnly:
    """A server behind which only requests of the page itself arrive; others are answered with 403, and reported."""

    def __init__(self, app: Server, on_reject: OnReject) -> None:
        self._app, self._on_reject = app, on_reject

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request, or one WebSocket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        send = _guarded(send)
        host, origin = header(scope, b"host") or "", header(scope, b"origin")
        against = reject_reason(host, origin) if VISITOR not in scope else ""
        if not against:
            await self._app(scope, receive, send)
            return
        self._on_reject(host if origin is None else origin, against)
        if scope["type"] == "websocket":
            await receive()
            await send({"type": "websocket.close", "code": 1008})
        else:
            await send({"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"text/plain")]})
            await send({"type": "http.response.body", "body": b"refused: " + against.encode()})


def policy(document: bytes) -> bytes:
    """The document's Content-Security-Policy: run the scripts that it came with, and load nothing from elsewhere.

    Markup that comes later brings no script of its own, handlers in attributes among them: those scripts alone are
    named, by their hashes. 'unsafe-eval' cannot go, since NiceGUI (3.18) compiles its components in the browser, nor
    can inline styles, which it sets on elements.
    """
    hashes = "".join(
        f" 'sha256-{b64encode(sha256(script.replace(CRLF, LF)).digest()).decode()}'"
        for script in _INLINE.findall(document)
    )
    return (
        f"default-src 'self'; script-src 'self' 'unsafe-eval'{hashes}; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data:; font-src 'self' data:; object-src 'none'; base-uri 'self'; form-action 'none'; "
        "frame-ancestors 'none'"
    ).encode()


def _guarded(send: Send) -> Send:
    """Every answer with its policy, and framed by no other page; a document waits until it is whole."""
    begun: MutableMapping[str, Any] = {}
    document = bytearray()

    async def guarded(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            begun.update(message)
            if _is_document(message):
                return
        elif message["type"] == "http.response.body" and _is_document(begun):
            document.extend(message.get("body", b""))
            if message.get("more_body", False):
                return
            await send(_with_guards(begun, bytes(document)))
            message = {"type": "http.response.body", "body": bytes(document)}
        await send(_with_guards(message, b"") if message["type"] == "http.response.start" else message)

    return guarded


def _is_document(start: Mapping[str, Any]) -> bool:
    return any(key.lower() == b"content-type" and value.startswith(b"text/html") for key, value in start["headers"])


def _with_guards(start: Mapping[str, Any], document: bytes) -> MutableMapping[str, Any]:
    own = (b"content-security-policy", policy(document))
    return {**start, "headers": [*start["headers"], own, *GUARDS]}


def reject_reason(host: str, origin: str | None) -> str:
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


def header(scope: Scope, name: bytes) -> str | None:
    """The value of a header, of one that comes twice both, which then is none of ours; None where there is none."""
    found = [value.decode("latin-1") for key, value in scope["headers"] if key.lower() == name]
    return " ".join(found) if found else None
