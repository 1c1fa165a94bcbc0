"""The page's door for other machines: behind a reverse proxy, by its address alone, and only for who is logged in.

It is a port of its own on loopback, which the proxy forwards to (`examples/nginx-page.conf`). The page's first port has
no login: who sits at this computer stops without one.
"""

from collections.abc import Callable, Mapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from gcs.page.origin import GUARDS, VISITOR, OnReject, Receive, Scope, Send, Server, header
from gcs.security.page_logins import Logins, Visitor
from wire.errors import ConfigError

COOKIE, LOG_IN, LOG_OUT = "__Host-formation", "/login", "/logout"
BODY_MOST = 4096
WRONG_TOKEN = "login with a token that is nobody's"
_CSP = b"default-src 'none'; style-src 'unsafe-inline'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
_FORM = """<!doctype html><html lang="en"><meta charset="utf-8"><title>formation: log in</title>
<style>body{{background:#10161d;color:#eef2f6;font:18px/1.5 sans-serif;max-width:26em;margin:15vh auto}}
input,button{{font:inherit;padding:8px;width:100%;box-sizing:border-box;margin:6px 0}}</style>
<h1>Log in</h1><p>{text}</p><form method="post" action="/login"><input name="token" type="password" required autofocus
autocomplete="current-password" aria-label="token"><button>Log in</button></form>
<p>Without a token: the STOP button in the room, or the ground computer.</p></html>"""
ASKS = "The token is in the file that <code>gcs keys token NAME</code> has written."


class Door:
    """The server of the page for other machines; who is not logged in is shown the form, and nothing else."""

    def __init__(
        self, app: Server, public: str, logins: Logins, now_ns: Callable[[], int], on_reject: OnReject
    ) -> None:
        """public: where browsers reach the proxy, https://HOST or https://HOST:PORT."""
        self._app, self._logins, self._now_ns, self._on_reject = app, logins, now_ns, on_reject
        self._origin, self._host = public.lower(), urlsplit(public).netloc.lower()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request, or one WebSocket."""
        if scope["type"] not in ("http", "websocket"):
            return
        address = str((scope.get("client") or ("?",))[0])
        against = self._reject_reason(scope)
        if against:
            self._on_reject(address, against)
            await _end(scope, receive, send, 403)
            return
        visitor = self._visitor(scope, address)
        if scope["type"] == "http" and scope["path"] == LOG_IN and scope["method"] == "POST":
            await self._log_in(address, receive, send)
        elif visitor is None and scope["type"] == "http":
            await _answer(send, 401, _FORM.format(text=ASKS).encode())
        elif visitor is None:
            await _end(scope, receive, send, 401)
        elif scope["path"] == LOG_OUT:
            self._logins.log_out(visitor.session)
            await _answer(send, 200, _FORM.format(text="You are logged out.").encode(), _cookie("", "; Max-Age=0"))
        else:
            await self._app({**scope, VISITOR: visitor}, receive, send)

    def _reject_reason(self, scope: Scope) -> str:
        """A browser names the page that asks in every POST and WebSocket: it must be ours."""
        origin = header(scope, b"origin")
        if (header(scope, b"host") or "").lower() != self._host:
            return f"its host is not {self._host}: does the proxy pass it on?"
        if origin is None and (scope["type"] == "websocket" or scope["method"] not in ("GET", "HEAD")):
            return "a request without an origin"
        return "" if origin is None or origin.lower() == self._origin else "a page of another origin"

    def _visitor(self, scope: Scope, address: str) -> Visitor | None:
        try:
            cookies = SimpleCookie(header(scope, b"cookie") or "")
            session = cookies[COOKIE].value if COOKIE in cookies else ""
            return self._logins.visitor(session, address, self._now_ns())
        except CookieError:
            return None
        except ConfigError as error:
            self._on_reject(address, str(error))
            return None

    async def _log_in(self, address: str, receive: Receive, send: Send) -> None:
        fields: Mapping[str, list[str]] = parse_qs((await _body(receive)).decode("ascii", "replace"))
        try:
            session = self._logins.log_in(fields.get("token", [""])[0].strip(), self._now_ns())
        except ConfigError as error:
            self._on_reject(address, str(error))
            session = ""
        if not session:
            self._on_reject(address, WRONG_TOKEN)
            await _answer(send, 401, _FORM.format(text="This token is nobody's.").encode())
            return
        await _answer(send, 303, b"", _cookie(session, ""), (b"location", b"/"))


def is_public(address: str) -> bool:
    """Whether it is where a proxy is reached: https://HOST or https://HOST:PORT, and nothing behind."""
    try:
        parts = urlsplit(address)
        named = f"https://{parts.hostname}" + (f":{parts.port}" if parts.port is not None else "")
    except ValueError:
        return False
    return bool(parts.hostname) and address.lower() == named


def _cookie(value: str, more: str) -> tuple[bytes, bytes]:
    return (b"set-cookie", f"{COOKIE}={value}; Path=/; Secure; HttpOnly; SameSite=Strict{more}".encode())


async def _body(receive: Receive) -> bytes:
    """The posted body; empty where it is too long."""
    body = b""
    while len(body) <= BODY_MOST:
        message: Mapping[str, Any] = await receive()
        body += message.get("body", b"")
        if message["type"] != "http.request" or not message.get("more_body", False):
            return body if len(body) <= BODY_MOST else b""
    return b""


async def _answer(send: Send, status: int, body: bytes, *headers: tuple[bytes, bytes]) -> None:
    own = ((b"content-type", b"text/html; charset=utf-8"), (b"content-security-policy", _CSP), *GUARDS)
    fresh = (b"cache-control", b"no-store")
    await send({"type": "http.response.start", "status": status, "headers": [*own, fresh, *headers]})
    await send({"type": "http.response.body", "body": body})


async def _end(scope: Scope, receive: Receive, send: Send, status: int) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008})
    else:
        await _answer(send, status, b"refused")
