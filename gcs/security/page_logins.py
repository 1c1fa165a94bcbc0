"""Who is logged in on a page that other machines reach: tokens in, sessions out; time is an argument.

The page's folder has the hashes of the operators' tokens alone.
"""

import json
import secrets
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from hashlib import sha256
from hmac import compare_digest
from pathlib import Path

from formation.security_config import Role
from wire.errors import ConfigError
from wire.files import read_text
from wire.security.private_keys import TOKENS, write_private
from wire.text import parse_object

TOKEN_BYTES = 32
SESSION_NS = 12 * 3600 * 10**9
SESSIONS_MOST = 16
"""Sessions of one operator: as many more end that operator's oldest, and nobody else's."""
_READ_NS = 500_000_000
"""How long what was read of the tokens counts: a revoked token ends its sessions within this."""


def token_hash(token: str) -> str:
    """The stored hash of a token. It is random, so that no slow hash is needed."""
    return sha256(token.encode()).hexdigest()


def read_tokens(folder: Path) -> Mapping[str, str]:
    """The hash of each operator's token, by name; none where no token was made. ConfigError."""
    try:
        tokens = parse_object(read_text(folder / TOKENS))
    except FileNotFoundError:
        return {}
    except (OSError, ValueError) as error:
        raise ConfigError([f"{folder / TOKENS}: no tokens: {error}"]) from error
    if not all(isinstance(each, str) for each in tokens.values()):
        raise ConfigError([f"{folder / TOKENS}: no tokens: `gcs keys token NAME` makes them"])
    return tokens


def new_token(folder: Path, name: str) -> str:
    """Make an operator's token, in the place of an older one. ConfigError, OSError."""
    token = secrets.token_urlsafe(TOKEN_BYTES)
    _write(folder, {**read_tokens(folder), name: token_hash(token)})
    return token


def drop_token(folder: Path, name: str) -> None:
    """An operator's token counts no more. ConfigError, OSError."""
    tokens = read_tokens(folder)
    if name in tokens:
        _write(folder, {key: value for key, value in tokens.items() if key != name})


def owner(token: str, tokens: Mapping[str, str]) -> str:
    """Whose token it is; empty for nobody's. Every hash is compared, each in constant time."""
    found, shown = "", token_hash(token)
    for name, hashed in tokens.items():
        if compare_digest(shown.encode(), hashed.encode()):
            found = name
    return found


def _write(folder: Path, tokens: Mapping[str, str]) -> None:
    write_private(folder / TOKENS, json.dumps(tokens, indent=1).encode())


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
