"""Tokens by which operators log in on the page from other machines. The page's folder has their hashes alone."""

import json
import secrets
from collections.abc import Mapping
from hashlib import sha256
from hmac import compare_digest
from pathlib import Path

from wire.errors import ConfigError
from wire.files import read_text
from wire.security.private_keys import TOKENS, write_private
from wire.text import parse_object

TOKEN_BYTES = 32


def token_hash(token: str) -> str:
    """What is stored of a token. It is random, so that no slow hash is needed."""
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
