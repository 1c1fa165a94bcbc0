"""The page's door for other machines: nobody gets through without a login, and nothing is said about the page."""

import asyncio
from collections.abc import Mapping
from hashlib import sha256
from typing import Any

import pytest

from formation.security_config import Role
from gcs.page.door import BODY_MOST, COOKIE, WRONG_TOKEN, Door, is_public
from gcs.page.origin import VISITOR, OwnPagesOnly
from gcs.security.page_logins import SESSION_NS, SESSIONS_MOST, Logins, Visitor
from tests.gcs.page.proxy import shipped_directives
from wire.errors import ConfigError

PUBLIC, HOST = "https://192.168.1.20:8443", "192.168.1.20:8443"
OPERATORS = {"anna": Role.OPERATOR, "board": Role.VIEWER}
TOKENS = {"anna": "token of anna", "board": "token of board", "gone": "token of one who left"}


def hashes() -> dict[str, str]:
    return {name: sha256(token.encode()).hexdigest() for name, token in TOKENS.items()}


class Site:
    """The door, a page behind it that answers with who asks, and a clock."""

    def __init__(self) -> None:
        self.tokens: Mapping[str, str] = hashes()
        self.now_ns = 0
        self.rejected: list[tuple[str, str]] = []
        self.reached: list[Visitor | None] = []
        self.logins = Logins(OPERATORS, lambda: self.tokens)
        page = OwnPagesOnly(self._page, lambda source, why: self.rejected.append((source, why)))
        self.door = Door(
            page, PUBLIC, self.logins, lambda: self.now_ns, lambda source, why: self.rejected.append((source, why))
        )

    async def _page(self, scope, _receive, send) -> None:
        self.reached.append(scope.get(VISITOR))
        if scope["type"] == "websocket":
            await send({"type": "websocket.accept"})
        else:
            await send({"type": "http.response.start", "status": 200, "headers": []})
            await send({"type": "http.response.body", "body": b"the page"})

    def ask(
        self, path: str = "/", method: str = "GET", body: bytes = b"", kind: str = "http", **headers: str
    ) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and body of an answer; of a WebSocket 101, or how it was closed."""
        fields = {"host": HOST, **headers}
        scope: dict[str, Any] = {
            "type": kind, "path": path, "method": method, "client": ("192.0.2.7", 4711),
            "headers": [(key.encode(), value.encode()) for key, value in fields.items()],
        }  # fmt: skip
        sent: list[dict[str, Any]] = []

        async def receive() -> dict[str, Any]:
            return {"type": "http.request", "body": body, "more_body": False}

        async def send(message) -> None:
            sent.append(dict(message))

        asyncio.run(self.door(scope, receive, send))
        if kind == "websocket":
            return (101 if sent[0]["type"] == "websocket.accept" else sent[0]["code"]), {}, b""
        answered = {key.decode(): value.decode() for key, value in sent[0]["headers"]}
        return sent[0]["status"], answered, b"".join(each.get("body", b"") for each in sent[1:])

    def log_in(self, token: str) -> str:
        """The cookie of a new session; empty without one."""
        _, headers, _ = self.ask("/login", "POST", f"token={token.replace(' ', '+')}".encode(), origin=PUBLIC)
        return headers.get("set-cookie", "").partition(";")[0]


@pytest.fixture
def site() -> Site:
    return Site()


def test_without_a_login_every_path_is_the_form(site: Site) -> None:
    for path in ("/", "/login", "/logout", "/_nicegui/3.18.0/static/nicegui.js", "/_nicegui_ws/socket.io/"):
        status, headers, body = site.ask(path)
        assert status == 401
        assert b"Log in" in body
        assert headers["content-security-policy"].startswith("default-src 'none'")
    assert site.ask("/_nicegui_ws/socket.io/", kind="websocket", origin=PUBLIC)[0] == 1008
    assert site.reached == []


def test_a_token_opens_the_page_in_its_owners_role(site: Site) -> None:
    _, headers, _ = site.ask("/login", "POST", b"token=token+of+board", origin=PUBLIC)
    assert headers["location"] == "/"
    cookie, *words = (word.strip() for word in headers["set-cookie"].split(";"))
    assert set(words) == {"Path=/", "Secure", "HttpOnly", "SameSite=Strict"}  # no script reads it
    assert cookie.startswith("__Host-")  # which a browser takes over TLS only, for this host only
    assert site.ask("/", cookie=cookie)[2] == b"the page"
    assert site.ask("/_nicegui_ws/", kind="websocket", cookie=cookie, origin=PUBLIC)[0] == 101
    assert {(v.name, v.role, v.address) for v in site.reached if v} == {("board", Role.VIEWER, "192.0.2.7")}
    assert len(site.reached) == 2


@pytest.mark.parametrize("token", ["", "nobody's", "token of one who left", "TOKEN OF ANNA", "\0"])
def test_a_token_that_is_no_operators_opens_nothing_and_is_reported(token: str, site: Site) -> None:
    assert not site.log_in(token)
    assert site.rejected == [("192.0.2.7", WRONG_TOKEN)]
    assert site.log_in("token of anna ")  # as it is pasted


@pytest.mark.parametrize("cookie", [COOKIE, f"{COOKIE}=", f"{COOKIE}=x", "x=y", ";;;", f"{COOKIE}={hashes()['anna']}"])
def test_no_cookie_of_ones_own_making_opens_the_page(cookie: str, site: Site) -> None:
    site.log_in("token of anna")
    assert site.ask("/", cookie=cookie)[0] == 401


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "127.0.0.1:8480"}, {"host": "evil.example"}, {"host": ""}, {"origin": "https://evil.example"},
        {"origin": "http://192.168.1.20:8443"}, {"origin": "null"},
    ],
)  # fmt: skip
def test_requests_for_another_host_or_by_another_page_are_refused_with_a_login_too(headers, site: Site) -> None:
    cookie = site.log_in("token of anna")
    assert site.ask("/", cookie=cookie, **headers)[0] == 403
    assert site.reached == []
    assert len(site.rejected) == 1


def test_what_changes_something_names_the_page_that_asks(site: Site) -> None:
    cookie = site.log_in("token of anna")
    assert site.ask("/", "POST", cookie=cookie)[0] == 403
    assert site.ask("/ws", kind="websocket", cookie=cookie)[0] == 1008
    assert site.ask("/login", "POST", b"token=token+of+anna")[0] == 403
    assert site.ask("/login", "POST", b"token=token+of+anna" + b"x" * BODY_MOST, origin=PUBLIC)[0] == 401


def test_sessions_end_with_the_log_out_with_time_with_the_token_and_with_too_many(site: Site) -> None:
    cookie = site.log_in("token of anna")
    site.ask("/logout", cookie=cookie)
    assert site.ask("/", cookie=cookie)[0] == 401
    cookie = site.log_in("token of anna")
    site.now_ns = SESSION_NS + 1
    assert site.ask("/", cookie=cookie)[0] == 401
    cookie = site.log_in("token of anna")
    site.tokens = {**hashes(), "anna": sha256(b"a new one").hexdigest()}
    site.now_ns += 1_000_000_000
    assert site.ask("/", cookie=cookie)[0] == 401
    first = site.log_in("a new one")
    for _ in range(SESSIONS_MOST):
        last = site.log_in("a new one")
    assert site.ask("/", cookie=first)[0] == 401
    for _ in range(5 * SESSIONS_MOST):
        site.log_in("token of board")
    assert site.ask("/", cookie=last)[0] == 200  # nobody's logins end another's session


def test_tokens_that_cannot_be_read_let_nobody_in(site: Site) -> None:
    def fails() -> Mapping[str, str]:
        raise ConfigError(["tokens: no tokens"])

    cookie = site.log_in("token of anna")
    site.logins._read_tokens = fails
    site.now_ns = 1_000_000_000
    assert site.ask("/", cookie=cookie)[0] == 401
    assert not site.log_in("token of anna")


@pytest.mark.parametrize(
    "wrong", ["http://192.168.1.20", "https://192.168.1.20/", "https://", "https://a@b", "https://a:b"]
)
def test_the_public_address_is_a_host_over_tls(wrong: str) -> None:
    assert is_public("https://192.168.1.20:8443")
    assert is_public("https://ground.lab")
    assert not is_public(wrong)


def test_the_shipped_proxy_demands_certificates_and_says_who_asks() -> None:
    """What it must say for the door to hold; `test_proxy` has a proxy of these headers carry the page."""
    directives = shipped_directives()
    assert directives["ssl_verify_client"] == "on"
    assert directives["ssl_client_certificate"] == "LAB/keys/page/ca.pem"
    assert directives["proxy_pass"] == "http://127.0.0.1:8480"
    assert directives["proxy_set_header Host"] == HOST
    assert directives["proxy_set_header X-Forwarded-For"] == "$remote_addr"  # and not what the client says of itself
