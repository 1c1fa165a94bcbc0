"""Names that users write: which known one is meant by one that is not known. Light: every command line loads it."""

from collections.abc import Iterable
from difflib import get_close_matches
from types import MappingProxyType

LONGEST, NEAR = 100, 0.7
"""Characters that are compared, and how alike a name must be to one that is known, to be taken for it."""
ALSO_CALLED = MappingProxyType({
    "optitrack": "natnet", "motive": "natnet", "qtm": "qualisys", "nexus": "vicon", "tracker": "vicon", "info": "check",
})  # fmt: skip
"""What users call a thing by another name: Motive speaks NatNet; QTM is Qualisys'; Nexus and Tracker are Vicon's."""


def meant(word: str, known: Iterable[str]) -> str:
    """`: is KNOWN meant?`, of the known name that is most like the word; empty where none is."""
    names = {name.lower(): name for name in known}
    other = ALSO_CALLED.get(word.lower(), "")
    near = [other] if other in names else get_close_matches(word.lower()[:LONGEST], names, 1, NEAR)
    return f": is {names[near[0]]} meant?" if near else ""


def unknown(word: str, known: Iterable[str]) -> str:
    """A name that a user wrote, in words: which known one may be meant, and all of them."""
    names = tuple(known)
    return f"{word!r}{meant(word, names)}; known: {', '.join(names) or 'none'}"
