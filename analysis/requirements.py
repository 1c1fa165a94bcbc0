"""What a flight is required to reach: `formation_rms_m<0.005`, held against its numbers."""

import operator
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, fields
from types import MappingProxyType

from analysis.metrics import Age, Latency, Summary

RELATIONS: Mapping[str, Callable[[float, float], bool]] = MappingProxyType(
    {"<=": operator.le, ">=": operator.ge, "<": operator.lt, ">": operator.gt}
)
WORDED = ("scenario", "link", "command_hash", "mcap", "report", "outcome")
USAGE = "a requirement is KEY<NUMBER, with <, <=, > or >=, such as formation_rms_m<0.005"


@dataclass(frozen=True, slots=True)
class Requirement:
    """One number of `analysis.metrics.Summary` and its bound, SI as there; `latency_ms.p99` is one of a group."""

    key: str
    relation: str
    bound: float

    @property
    def text(self) -> str:
        """As `parse` reads it."""
        return f"{self.key}{self.relation}{self.bound:g}"

    def unmet(self, summary: Summary) -> str | None:
        """Why the flight does not reach it; None where it does. A number that the log does not have is not reached."""
        value: object = asdict(summary)
        for part in self.key.split("."):
            value = value.get(part) if isinstance(value, dict) else None
        if not isinstance(value, int | float):
            return f"{self.text} is required, and not known of this flight"
        reached = RELATIONS[self.relation](value, self.bound)
        return None if reached else f"{self.text} is required, it is {value:.4g}"


def parse(text: str) -> Requirement:
    """The requirement in such words; ValueError says what is not understood, and which keys there are."""
    found = re.fullmatch(r"\s*([a-z0-9_.]+)\s*(<=|>=|<|>)\s*(\S+)\s*", text)
    if found is None:
        raise ValueError(f"{text!r} is not understood: {USAGE}")
    key, relation, number = found.groups()
    if key not in KEYS:
        raise ValueError(f"{key!r} is no number of a flight; known: {', '.join(KEYS)}")
    try:
        return Requirement(key, relation, float(number))
    except ValueError as error:
        raise ValueError(f"{number!r} is not a number: {USAGE}") from error


def unmet(requirements: Iterable[Requirement], summary: Summary) -> tuple[str, ...]:
    """Of each that the flight does not reach, why."""
    return tuple(why for requirement in requirements if (why := requirement.unmet(summary)) is not None)


def _keys() -> tuple[str, ...]:
    groups = {"mocap_ms": Latency, "latency_ms": Latency, "age_ms": Age, "link_behind_ms": Latency}
    keys: list[str] = []
    for field in fields(Summary):
        group = groups.get(field.name)
        if group is not None:
            keys += [f"{field.name}.{part.name}" for part in fields(group)]
        elif field.name not in WORDED:
            keys.append(field.name)
    return tuple(keys)


KEYS = _keys()
"""Every number that can be required."""
