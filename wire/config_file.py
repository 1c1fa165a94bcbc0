"""TOML files read into the frozen models of `formation.config`, and models written as TOML.

Every error is one line that names the file, the line, the key and the reason.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from formation.model import Model, WrongKeyError
from formation.names import meant
from formation.vehicle.profile import VehicleProfile, on_base, profile
from wire.errors import ConfigError as ConfigError
from wire.errors import Fault as Fault
from wire.files import INCLUDE, read_text, read_toml

_PART = r"(?:[A-Za-z0-9_-]+|\"[^\"]*\"|'[^']*')"
_KEY = rf"{_PART}(?:\s*\.\s*{_PART})*"
_LINE = re.compile(rf"\s*(?:(\[\[?)\s*({_KEY})\s*\]|({_KEY})\s*=(.*))", re.DOTALL)
_TEXT = re.compile(r"\"{3}.*?(?:\"{3}|$)|'{3}.*?(?:'{3}|$)|\"(?:[^\"\\\n]|\\.)*\"|'[^'\n]*'|#[^\n]*", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Lines:
    """A file's lines by key as messages have it, `followers[0].offset_m`, and the followers' names by theirs.

    included: of the file that it includes.
    """

    source: str
    lines: Mapping[str, int]
    bodies: Mapping[str, str]
    included: "Lines | None" = None

    def of(self, key: str) -> str:
        """How a message begins: `lab.toml:14 followers[1].offset_m (left)`."""
        above, line = self._nearest(key)
        if self.included is not None and len(self.included._nearest(key)[0]) > len(above):
            return self.included.of(key)
        body = next((name for owner, name in self.bodies.items() if key.startswith(owner)), "")
        return f"{self.source}:{line or ''} {key}{f' ({body})' if body else ''}".rstrip()

    def _nearest(self, key: str) -> tuple[str, int]:
        """The key, or the nearest table above it, that the file has, and its line; nothing and 0 for none."""
        while key and not (line := self.lines.get(key) or self.lines.get(f"{key}[0]", 0)):
            key = key[: max(key.rfind("."), key.rfind("["), 0)]
        return (key, line) if key else ("", 0)


def lines_of(path: Path, follow: bool = True) -> Lines:
    """Those of the file, and of the one that it includes; none where it cannot be read any more."""
    try:
        text = read_text(path)
        values = tomllib.loads(text)
    except (OSError, ValueError):
        return Lines(str(path), {}, {})
    lines: dict[str, int] = {}
    for key, line in _keys(text):
        lines.setdefault(key, line)
    followers = values.get("followers")
    named = enumerate(followers if isinstance(followers, list) else ())
    bodies = {f"followers[{i}]": str(each["body"]) for i, each in named if isinstance(each, dict) and "body" in each}
    name = values.get(INCLUDE) if follow else None
    return Lines(
        str(path), lines, bodies, lines_of(path.parent / name, follow=False) if isinstance(name, str) else None
    )


def _keys(text: str) -> Iterator[tuple[str, int]]:
    """Each table and key of the text with its line, counted from 1; what is inside a list is at the list's."""
    table, counts, rest = "", dict[str, int](), ""
    for number, line in enumerate(text.splitlines(), 1):
        rest = f"{rest}\n{line}" if rest else line
        bare = _TEXT.sub("", rest)
        is_open = bare.count("[") + bare.count("{") > bare.count("]") + bare.count("}")
        if is_open or any(rest.count(mark) % 2 for mark in ('"""', "'''")):
            continue
        found, first, rest = _LINE.match(rest), number - rest.count("\n"), ""
        if found is None:
            continue
        if found[1] is None:
            yield f"{table}.{_plain(found[3])}".lstrip("."), first
            continue
        parts = _plain(found[2]).split(".")
        for k in range(len(parts) - (found[1] == "[[")):  # tables of the newest of a list
            inner = ".".join(parts[: k + 1])
            if inner in counts:
                parts = [f"{inner}[{counts[inner]}]", *parts[k + 1 :]]
                break
        table = ".".join(parts)
        if found[1] == "[[":
            counts[table] = counts.get(table, -1) + 1
            table = f"{table}[{counts[table]}]"
        yield table, first


def _plain(key: str) -> str:
    return re.sub(r"\s*\.\s*", ".", key).replace('"', "").replace("'", "")


M = TypeVar("M", bound=Model)

SHORT, LONG = 8, 80
"""So many numbers of a list are shown, and so many characters of a value."""
REASONS = {
    "missing": "is missing",
    "extra_forbidden": "is not a known key",
    "tuple_type": "is not a list, [...]",
    "list_type": "is not a list, [...]",
    "model_type": "is not a table",
    "model_attributes_type": "is not a table",
    "dict_type": "is not a table",
    "float_type": "is not a number",
    "float_parsing": "is not a number",
    "int_type": "is not a whole number",
    "int_parsing": "is not a whole number",
    "int_from_float": "is not a whole number",
    "bool_type": "is neither true nor false",
    "bool_parsing": "is neither true nor false",
    "string_type": "is not text in quotes",
    "finite_number": "is not a finite number",
}


def load(path: Path, model: type[M]) -> M:
    """The model in the TOML file at `path`; ConfigError for a file that is missing, no TOML, or not such a model."""
    return parse_read(read_toml(path), model, path)


def parse_read(values: dict[str, Any], model: type[M], path: Path) -> M:
    """The model in values that were read from a TOML file; ConfigError, its lines led by file and line."""
    try:
        return parse(values, model, source=str(path), folder=path.parent)
    except ConfigError as error:
        at = lines_of(path)
        lines = [fault.text(at.of(fault.key)) for fault in error.faults]
        raise ConfigError(lines or error.problems, error.faults, error.source) from error


def parse(values: dict[str, Any], model: type[M], *, source: str, folder: Path | None = None) -> M:
    """The model in `values`; ConfigError, its lines led by `source`. folder: where files that it names are."""
    context = None
    if folder is not None:
        from wire.lab_surroundings import Surroundings  # trajectories and laws, which a drone's process has none of

        context = Surroundings(folder)
    try:
        return model.model_validate(values, context=context)
    except ValidationError as error:
        faults = error.errors()
        # Of a list with a bad item pydantic also says that it is too short: the item is the reason.
        inner = {fault["loc"][:1] for fault in faults if len(fault["loc"]) > 1}
        reported = [
            _fault(fault, model) for fault in faults if fault["type"] != "too_short" or fault["loc"] not in inner
        ]
        raise ConfigError([f"{source}: {fault}" for fault in reported], reported, source) from error


def _fault(found: ErrorDetails, model: type[Model]) -> Fault:
    """One of pydantic's errors in our words."""
    kind, location = found["type"], found["loc"]
    key, value, reason = _key(location), _value(kind, found["input"]), _reason(kind, found["msg"], found["input"])
    raised = found.get("ctx", {}).get("error")
    if isinstance(raised, WrongKeyError):
        key = ".".join(filter(None, (key, raised.key)))
        value = "" if raised.value is None else _shown(raised.value)
    elif kind == "extra_forbidden":
        near = meant(str(location[-1]), _known_keys(model, location[:-1]))
        elsewhere = [table for table, name in _tables(model) if name == location[-1]]
        reason += near or _belongs(elsewhere)
    elif kind == "literal_error":
        reason += meant(str(found["input"]), re.findall("'([^']*)'", found["ctx"]["expected"]))
    return Fault(key, value, reason)


def _key(location: tuple[int | str, ...]) -> str:
    """ "followers[1].offset_m", nothing for the file as a whole."""
    key = ""
    for part in location:
        key += f"[{part}]" if isinstance(part, int) else f".{part}" if key else part
    return key


def _known_keys(model: type[Model], location: tuple[int | str, ...]) -> list[str]:
    """The keys of the table there; none where it is no model's."""
    inner: Any = model
    for part in location:
        kind = _model_in(inner)
        if kind is not None and part in kind.model_fields:
            inner = kind.model_fields[str(part)].annotation
    kind = _model_in(inner)
    return [] if kind is None else list(kind.model_fields)


def _model_in(annotation: Any) -> type[Model] | None:
    """The model in `Model`, `Model | None`, `tuple[Model, ...]` or `dict[str, Model]`."""
    if isinstance(annotation, type) and issubclass(annotation, Model):
        return annotation
    return next((found for part in get_args(annotation) if (found := _model_in(part)) is not None), None)


def _value(kind: str, value: Any) -> str:
    """The value as written, or nothing where there is none or much of it."""
    if kind in ("missing", "extra_forbidden") or isinstance(value, dict):
        return ""
    if isinstance(value, list) and (len(value) > SHORT or any(isinstance(item, dict | list) for item in value)):
        return ""
    return _shown(value)


def _shown(value: object) -> str:
    """A value in one short line."""
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        return "a number of thousands of digits"
    return text if len(text) <= LONG else f"{text[: LONG - 3]}..."


def _belongs(tables: list[str]) -> str:
    """Where an unknown key would be known; nothing for one that is unknown everywhere, or known everywhere."""
    if not tables or len(tables) > 2:
        return ""
    where = " or ".join(f"in {table}" if table else "at the top of the file, before any table" for table in tables)
    return f": it belongs {where}"


def _tables(model: type[Model], table: str = "") -> Iterator[tuple[str, str]]:
    """Every table as a file heads it, and each of its keys."""
    for name, field in model.model_fields.items():
        yield (f"[{table}]" if table and not table.startswith("[") else table), name
        inner = _model_in(field.annotation)
        if inner is not None and "dict" not in str(field.annotation):
            is_list = "tuple" in str(field.annotation)
            path = f"{table}.{name}".lstrip(".")
            yield from _tables(inner, f"[[{path}]]" if is_list else path)


def _reason(kind: str, message: str, value: object) -> str:
    if kind in ("tuple_type", "list_type") and isinstance(value, dict):
        return "is one table: each of a list has double brackets, [[...]]"
    if kind in ("model_type", "dict_type", "model_attributes_type") and isinstance(value, list):
        return "is a list of tables: there is one alone, [...] in single brackets"
    return REASONS.get(kind, message.removeprefix("Value error, ").replace("Input should be", "should be"))


def dump_profile(profile: VehicleProfile) -> str:
    """The profile as an entry `[[profiles]]`: to be appended to a lab file, or read by `load_profile`."""
    import tomli_w

    return tomli_w.dumps({"profiles": [profile.model_dump(mode="json", exclude_none=True)]})


def vehicle_profile(name_or_path: str) -> VehicleProfile:
    """A shipped vehicle, or one of a profile's TOML file; ConfigError where there is none."""
    path = Path(name_or_path)
    if path.exists():
        return load_profile(path)
    try:
        return profile(name_or_path)
    except ValueError as error:
        raise ConfigError([str(error)]) from error


def load_profile(path: Path) -> VehicleProfile:
    """The only profile in a file as `dump_profile` writes it, or its keys alone; ConfigError."""
    values = read_toml(path)
    entries = values.get("profiles", [values])
    if not isinstance(entries, list) or len(entries) != 1 or not isinstance(entries[0], dict):
        raise ConfigError([f"{path}: profiles: one entry [[profiles]] is wanted"])
    try:
        whole = on_base(entries[0])
    except ValueError as error:
        raise ConfigError([f"{path}: base: {error}"]) from error
    return parse(whole, VehicleProfile, source=str(path))


def dump(model: Model) -> str:
    """TOML text that `load` reads back as the same model; what is None is left out."""
    import tomli_w

    return tomli_w.dumps(model.model_dump(mode="json", exclude_none=True))
