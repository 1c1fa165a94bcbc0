"""Who is logged in on a page that other machines reach: tokens in, sessions out. Pure; time is an argument."""

import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from formation.security_config import Role
from gcs.security.page_tokens import owner, token_hash

SESSION_NS = 12 * 3600 * 10**9
SESSIONS_MOST = 16
"""Of one operator: as many more end that operator's oldest, and nobody else's."""
_READ_NS = 500_000_000
"""How long what was read of the tokens counts: a revoked token ends its sessions within this."""


@dataclass(frozen=True, slots=True)
class Visitor:
    """Who looks at the page from another machine: which operator, in which role, from which address."""

    name: str
    role: Role
    address: str
    session: str


@dataclass(frozen=True, slots=True)
class _Session:
    name: str
    hashed: str
    """The hash of the token that it began with: a new token ends the sessions of the old one."""
    until_ns: int


class Logins:
    """Sessions by their secret; an operator's oldest ends where that one has too many."""

    def __init__(self, operators: Mapping[str, Role], read_tokens: Callable[[], Mapping[str, str]]) -> None:
        """read_tokens: the hash of each operator's token, as they are now; may raise ConfigError."""
        self._operators, self._read_tokens = operators, read_tokens
        self._tokens: Mapping[str, str] = {}
        self._read_ns: int | None = None
        self._sessions: dict[str, _Session] = {}

    def log_in(self, token: str, now_ns: int) -> str:
        """A new session's secret; empty for a token that is nobody's. ConfigError."""
        self._read_ns = None
        tokens = self._current(now_ns)
        name = owner(token, tokens)
        if not name:
            return ""
        own = [key for key, each in self._sessions.items() if each.name == name]
        if len(own) >= SESSIONS_MOST:
            del self._sessions[own[0]]
        session = secrets.token_urlsafe(32)
        self._sessions[token_hash(session)] = _Session(name, tokens[name], now_ns + SESSION_NS)
        return session

    def log_out(self, session: str) -> None:
        """End a session."""
        self._sessions.pop(token_hash(session), None)

    def visitor(self, session: str, address: str, now_ns: int) -> Visitor | None:
        """Who a session's secret is of; None where it is of nobody, any more. ConfigError."""
        found = self._sessions.get(token_hash(session))
        if found is None:
            return None
        if now_ns > found.until_ns or self._current(now_ns).get(found.name) != found.hashed:
            self.log_out(session)
            return None
        return Visitor(found.name, self._operators[found.name], address, session)

    def _current(self, now_ns: int) -> Mapping[str, str]:
        """The tokens of those who are operators in the lab file."""
        if self._read_ns is None or now_ns - self._read_ns > _READ_NS:
            self._tokens = {k: v for k, v in self._read_tokens().items() if k in self._operators}
            self._read_ns = now_ns
        return self._tokens
