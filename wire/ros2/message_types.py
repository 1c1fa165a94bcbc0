"""ROS 2's message types without ROS: from a definition follow layout, CDR, type hash and the schema of an MCAP file.

`definitions.msg` holds the definitions, joined as an MCAP schema joins them: some of ROS 2's common interfaces, and the
poses of motion_capture_tracking. CDR is OMG's XCDR1, little-endian; the hash is RIHS01 (REP-2016).

A message is a flat tuple of numbers and texts in the order of its definition. Nested messages and arrays of fixed
length are spread out in it. A sequence is a tuple of such tuples.
"""

import json
import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, lru_cache
from hashlib import sha256
from importlib.resources import files
from typing import Any

Values = tuple[Any, ...]
Layout = tuple["Part", ...]
COUNT = "I"
TEXT: Layout = ()
_SEPARATOR = "=" * 80
_HEADER = bytes((0, 1, 0, 0))
"""Of a CDR in little-endian byte order."""
_CODES = {
    "bool": "?", "byte": "B", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i",
    "uint32": "I", "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_NUMBERS_OF_TYPES = {
    "int8": 2, "uint8": 3, "char": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9,
    "float32": 10, "float64": 11, "bool": 15, "byte": 16, "string": 17,
}  # fmt: skip
"""Of type_description_interfaces/FieldType; 1 is a nested message. A `char` of a definition is a uint8."""
_SINGLE, _FIXED, _BOUNDED, _UNBOUNDED = 0, 48, 96, 144
"""What FieldType adds for an array of that kind."""
_FIELD = re.compile(r"(?P<kind>[\w/]+)(?:\[(?P<bound><=)?(?P<size>\d*)(?P<array>\]))?\s+(?P<name>\w+)(?:\s+\S+)?")


class CdrError(ValueError):
    """Bytes that are no message of their type."""


@dataclass(frozen=True, slots=True)
class Field:
    """A member of a message; kind: of a number, `string`, or a type's full name. array: _SINGLE to _UNBOUNDED."""

    name: str
    kind: str
    array: int = _SINGLE
    size: int = 0


@dataclass(frozen=True, slots=True)
class Part:
    """Numbers in a row, by `struct`'s codes, the first `own` of them the message's own; then what the last one counts.

    items: the layout of a sequence's items, empty for a text; None where nothing follows.
    """

    codes: str
    own: int
    items: Layout | None = None


@dataclass(frozen=True, slots=True)
class MessageType:
    """A message or service by its full name, `geometry_msgs/msg/Pose`. hash: `RIHS01_...`.

    definition: with all that it refers to, as MCAP's encoding `ros2msg`.
    """

    name: str
    hash: str
    definition: str
    layout: Layout

    @property
    def dds_name(self) -> str:
        """As rmw_zenoh's keys have it: `geometry_msgs::msg::dds_::Pose_`."""
        package, kind, name = self.name.split("/")
        return f"{package}::{kind}::dds_::{name}_"

    def encode(self, values: Values) -> bytes:
        """The CDR of a message. ValueError for other values than the definition's."""
        out = bytearray()
        try:
            _write(self.layout, values, out)
        except struct.error as error:
            raise ValueError(f"{self.name}: {error}") from error
        return _HEADER + out

    def decode(self, data: bytes) -> Values:
        """The message of a CDR; CdrError for all else."""
        if len(data) < len(_HEADER) or data[:2] != _HEADER[:2]:  # the other two count the padding, where they count
            raise CdrError(f"{self.name}: no CDR in little-endian byte order")
        body = memoryview(data)[len(_HEADER) :]
        try:
            values, end = _read(self.layout, body, 0)
        except struct.error as error:
            raise CdrError(f"{self.name}: ends too early") from error
        if len(body) - end > 3:  # padding
            raise CdrError(f"{self.name}: {len(body) - end} bytes too long")
        return values


def ros_name(text: str) -> str:
    """A name for topics: every character that ROS does not allow is replaced by _, none begins with a digit."""
    return re.sub(r"^(?=\d)|[^A-Za-z0-9_]", "_", text)


@cache
def message_type(name: str) -> MessageType:
    """The type of that full name; KeyError for one that `definitions.msg` does not have."""
    referred = sorted(_referred(name))
    described = {"type_description": _description(name), "referenced_type_descriptions": [*map(_description, referred)]}
    texts = [_definitions()[name], *(f"MSG: {_short(other)}\n{_definitions()[other]}" for other in referred)]
    digest = sha256(json.dumps(described).encode()).hexdigest()
    return MessageType(name, f"RIHS01_{digest}", f"{_SEPARATOR}\n".join(texts), _layout(name))


@cache
def _definitions() -> Mapping[str, str]:
    """By full name; of a service its parts, and itself, as rosidl makes messages of it."""
    found: dict[str, str] = {}
    for text in files(__package__).joinpath("definitions.msg").read_text(encoding="utf-8").split(f"{_SEPARATOR}\n"):
        head, _, body = text.partition("\n")
        kind, _, short = head.partition(": ")
        name = short.replace("/", f"/{kind.lower()}/")
        if kind == "MSG":
            found[name] = body
        else:
            request, _, response = body.partition("---\n")
            found[f"{name}_Request"], found[f"{name}_Response"] = request, response
            found[f"{name}_Event"] = (
                f"service_msgs/ServiceEventInfo info\n{name}_Request[<=1] request\n{name}_Response[<=1] response\n"
            )
            found[name] = (
                f"{name}_Request request_message\n{name}_Response response_message\n{name}_Event event_message\n"
            )
    return found


def _short(name: str) -> str:
    return name.replace("/msg/", "/")


@cache
def _fields(name: str) -> tuple[Field, ...]:
    """The members of a type; one that stands in where it has none."""
    lines = (line.strip() for line in _definitions()[name].splitlines() if "=" not in line.replace("<=", ""))
    return tuple(_field(line, name) for line in lines if line) or (
        Field("structure_needs_at_least_one_member", "uint8"),
    )


def _field(line: str, owner: str) -> Field:
    found = _FIELD.fullmatch(line)
    if found is None:
        raise ValueError(f"{owner}: not a member of a message: {line}")
    kind, size = found["kind"], int(found["size"] or 0)
    if kind not in _NUMBERS_OF_TYPES:
        parts = kind.split("/")
        package = parts[0] if len(parts) > 1 else owner.split("/")[0]
        kind = kind if len(parts) > 2 else f"{package}/msg/{parts[-1]}"
    array = _SINGLE if not found["array"] else _BOUNDED if found["bound"] else _FIXED if size else _UNBOUNDED
    return Field(found["name"], kind, array, size)


def _referred(name: str) -> set[str]:
    """The types inside a type, and inside those."""
    inner = {field.kind for field in _fields(name) if field.kind not in _NUMBERS_OF_TYPES}
    return inner.union(*map(_referred, inner))


def _description(name: str) -> Mapping[str, object]:
    """type_description_interfaces/IndividualTypeDescription, of which the hash is made."""
    return {"type_name": name, "fields": [{"name": f.name, "type": _field_type(f)} for f in _fields(name)]}


def _field_type(field: Field) -> Mapping[str, object]:
    nested = "" if field.kind in _NUMBERS_OF_TYPES else field.kind
    number = 1 if nested else _NUMBERS_OF_TYPES[field.kind]
    return {
        "type_id": number + field.array, "capacity": field.size, "string_capacity": 0, "nested_type_name": nested,
    }  # fmt: skip


@cache
def _layout(name: str) -> Layout:
    parts, codes = list[Part](), ""
    for atom in _atoms(name):
        if isinstance(atom, str):
            codes += atom
        else:
            parts.append(Part(codes + COUNT, len(codes), atom))
            codes = ""
    return (*parts, Part(codes, len(codes))) if codes else tuple(parts)


def _atoms(name: str) -> Iterator[str | Layout]:
    """The members spread out: the code of a number, the layout of a sequence's items, or an empty one for a text."""
    for field in _fields(name):
        code = _CODES.get(field.kind)
        if field.array in (_BOUNDED, _UNBOUNDED):
            yield _layout(field.kind) if code is None else (Part(code, 1),)
        else:
            for _ in range(max(field.size, 1)):
                yield from _atoms(field.kind) if "/" in field.kind else (code or TEXT,)


@lru_cache(maxsize=256)
def _run(codes: str, phase: int) -> struct.Struct:
    """Numbers in a row that begin `phase` bytes behind a multiple of eight, each aligned to its size."""
    text = "<"
    for code in codes:
        size = struct.calcsize(code)
        text += "x" * (-phase % size) + code
        phase += -phase % size + size
    return struct.Struct(text)


def _write(layout: Layout, values: Values, out: bytearray) -> None:
    at = 0
    for part in layout:
        run, end = _run(part.codes, len(out) % 8), at + part.own
        if part.items is None:
            out += run.pack(*values[at:end])
            at = end
            continue
        counted = values[end] if part.items else values[end].encode() + b"\0"
        out += run.pack(*values[at:end], len(counted))
        at = end + 1
        if part.items:
            for item in counted:
                _write(part.items, item, out)
        else:
            out += counted
    if at != len(values):
        raise struct.error(f"{at} values are wanted, not {len(values)}")


def _read(layout: Layout, data: memoryview, at: int) -> tuple[Values, int]:
    """The values from `at` on, and where they end. struct.error where the data end before."""
    values: list[Any] = []
    for part in layout:
        run = _run(part.codes, at % 8)
        values += run.unpack_from(data, at)
        at += run.size
        if part.items is None:
            continue
        count = values.pop()
        if count > len(data) - at:
            raise struct.error(f"{count} items in {len(data) - at} bytes")
        if part.items:
            items: list[Values] = []
            for _ in range(count):
                item, at = _read(part.items, data, at)
                items.append(item)
            values.append(tuple(items))
        else:
            values.append(str(data[at : at + max(count - 1, 0)], "utf-8", "replace"))
            at += count
    return tuple(values), at
