"""Protobuf for the messages of the spine, derived from their annotations: no .proto file says anything twice.

int is sfixed64, float is double, str string, bytes bytes, an IntEnum an enum, a StrEnum string, tuple[str, ...]
repeated string, an array packed doubles (or bools, or, of uint8, bytes) in C order with the shape of
`formation.maths.arrays`, packed floats where that says single; None is absent.
Every other float64 comes back bit for bit. Fields are numbered in the order of the dataclass, from one.
"""

import dataclasses
import struct
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from functools import cache, cached_property, partial
from operator import attrgetter, call
from typing import (
    TYPE_CHECKING,
    Annotated,
    Any,
    Generic,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

if TYPE_CHECKING:  # neither is loaded before it is needed
    import numpy as np
    from google.protobuf import descriptor_pb2

PACKAGE = "formation"


class Proto(IntEnum):
    """Google's numbers of the field types used, of FieldDescriptorProto.Type."""

    TYPE_DOUBLE = 1
    TYPE_FLOAT = 2
    TYPE_BOOL = 8
    TYPE_STRING = 9
    TYPE_BYTES = 12
    TYPE_ENUM = 14
    TYPE_SFIXED64 = 16


T = TypeVar("T")


VARINT, _FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
_SFIXED64 = struct.Struct("<q")
_DOUBLE = struct.Struct("<d")


class SchemaError(ValueError):
    """Bytes that do not hold a message of the schema."""


@dataclass(frozen=True, slots=True)
class Numbers:
    """How the numbers of a field lie in its bytes. stored: numpy's type of each; shape: -1 is as many as there are."""

    stored: Any
    shape: tuple[int, ...] = ()
    is_flags: bool = False


@dataclass(frozen=True, slots=True)
class Kind:
    """One field's type: its Protobuf type, how its value becomes bytes (for a tag, tag and all), and back."""

    proto: int
    wire: int
    encoder: Callable[[bytes], Callable[[Any], bytes]]
    decode: Callable[[Any], Any]
    default: Any
    numbers: Numbers | None = None
    repeated: bool = False
    many: bool = False  # one tag an item
    enum: type[IntEnum] | None = None
    older: "Kind | None" = None  # as earlier versions wrote it


@dataclass(frozen=True, slots=True)
class Field:
    """One field of a message."""

    name: str
    number: int
    kind: Kind
    optional: bool
    default: Any


class Schema(Generic[T]):
    """The Protobuf schema of one dataclass."""

    def __init__(self, message: type[T]) -> None:
        self.message = message
        self.name = f"{PACKAGE}.{message.__name__}"
        self._fields = _fields_of(message)
        names = [f.name for f in self._fields]
        self._values: Callable[[T], tuple[Any, ...]] = (
            attrgetter(*names) if len(names) > 1 else lambda message: tuple(getattr(message, name) for name in names)
        )
        self._whole = not any(f.optional for f in self._fields)
        self._encoders = [f.kind.encoder(varint(f.number << 3 | f.kind.wire)) for f in self._fields]

    @cached_property
    def descriptor_set(self) -> bytes:
        """The FileDescriptorSet, as it is kept with the data."""
        return described(self.message.__name__, self._fields).SerializeToString()

    def encode(self, message: T) -> bytes:
        """Protobuf bytes; raises ValueError, TypeError or struct.error if a value is not of its annotation."""
        values = self._values(message)
        if self._whole:
            return b"".join(map(call, self._encoders, values))
        pairs = zip(self._encoders, values, strict=True)
        return b"".join([encode(value) for encode, value in pairs if value is not None])

    @cached_property
    def own(self) -> "Written[T]":
        """As this version writes it."""
        return Written(self.message, self._fields, {f.number << 3 | f.kind.wire: f for f in self._fields})

    def decode(self, data: bytes) -> T:
        """As `Written.decode`, of this version's own."""
        return self.own.decode(data)

    def written(self, descriptor_set: bytes) -> "Written[T]":
        """As another version wrote it: fields are matched by name and type.

        descriptor_set: the FileDescriptorSet kept with the data. Raises SchemaError if it is none.
        """
        from google.protobuf import descriptor_pb2
        from google.protobuf.message import DecodeError

        if descriptor_set == self.descriptor_set:
            return self.own
        written = descriptor_pb2.FileDescriptorSet()
        try:
            written.ParseFromString(descriptor_set)
        except DecodeError as error:
            raise SchemaError(f"{self.name}: its schema cannot be read: {error}") from error
        found = [m for file in written.file for m in file.message_type if m.name == self.message.__name__]
        if not found:
            raise SchemaError(f"{self.name} is not in its own schema")
        known = {
            (f.name, kind.proto): dataclasses.replace(f, kind=kind)
            for f in self._fields
            for kind in (f.kind, f.kind.older)
            if kind is not None
        }
        read = [(field.number, known[key]) for field in found[0].field if (key := (field.name, field.type)) in known]
        return Written(self.message, self._fields, {number << 3 | field.kind.wire: field for number, field in read})


class Written(Generic[T]):
    """The messages of a schema as one version wrote them. by_tag: the fields that it knew, by their tags there."""

    def __init__(self, message: type[T], fields: Sequence[Field], by_tag: Mapping[int, Field]) -> None:
        self.message, self.fields, self.by_tag = message, fields, by_tag

    @property
    def left_out(self) -> frozenset[str]:
        """The names of the fields that it did not know."""
        return frozenset(field.name for field in self.fields) - {field.name for field in self.by_tag.values()}

    def decode(self, data: bytes) -> T:
        """The message in `data`; fields of a later version are skipped, absent ones take their default.

        Raises SchemaError, nothing else.
        """
        by_tag = self.by_tag
        values: dict[str, Any] = {}
        many: dict[str, list[Any]] = {}
        try:
            for tag, raw in tagged(data):
                field = by_tag.get(tag)
                if field is None:
                    continue
                kind = field.kind
                value = kind.decode(raw)
                if kind.many:
                    many.setdefault(field.name, []).append(value)
                else:
                    values[field.name] = value
        except (ValueError, IndexError, struct.error) as error:
            raise SchemaError(f"{PACKAGE}.{self.message.__name__}: {error}") from error
        for name, items in many.items():
            values[name] = tuple(items)
        if len(values) < len(self.fields):
            for field in self.fields:
                values.setdefault(field.name, None if field.optional else field.default)
        return self.message(**values)


@cache
def schema_of(message: type[T]) -> Schema[T]:
    """The schema of a dataclass, made once; TypeError names a field whose annotation has no Protobuf type."""
    return Schema(message)


def described(name: str, fields: Sequence[Field]) -> "descriptor_pb2.FileDescriptorSet":
    """The FileDescriptorSet of one message of these fields, for readers that know nothing of us."""
    from google.protobuf import descriptor_pb2

    label_of = descriptor_pb2.FieldDescriptorProto
    message = descriptor_pb2.DescriptorProto(name=name)
    for field in fields:
        label = label_of.LABEL_REPEATED if field.kind.repeated else label_of.LABEL_OPTIONAL
        proto = message.field.add(name=field.name, number=field.number, label=label)
        proto.type = field.kind.proto  # type: ignore[assignment]
        if field.kind.enum is not None:
            proto.type_name = f".{PACKAGE}.{name}.{field.kind.enum.__name__}"
            _add_enum(message, field.kind.enum)
    file = descriptor_pb2.FileDescriptorProto(name=f"{PACKAGE}/{name}.proto", package=PACKAGE, syntax="proto3")
    file.message_type.append(message)
    return descriptor_pb2.FileDescriptorSet(file=[file])


def _add_enum(message: "descriptor_pb2.DescriptorProto", enum: type[IntEnum]) -> None:
    values = {member.value: member.name for member in enum}
    values.setdefault(0, "UNSPECIFIED")  # proto3 wants a zero, and wants it first
    proto = message.enum_type.add(name=enum.__name__)
    for number in sorted(values):
        proto.value.add(name=values[number], number=number)


def varint(value: int) -> bytes:
    """Protobuf's bytes of a number that is not negative."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


# Lengths are small: a table of the first of them is what keeps arrays cheap.
_LENGTHS = tuple(varint(n) for n in range(4096))


def _sized(data: bytes) -> bytes:
    size = len(data)
    return (_LENGTHS[size] if size < 4096 else varint(size)) + data


def _read_varint(data: bytes, at: int) -> tuple[int, int]:
    value = data[at]
    at += 1
    if value < 0x80:
        return value, at
    value &= 0x7F
    for shift in range(7, 70, 7):
        byte = data[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
    raise SchemaError("a varint longer than ten bytes")


def tagged(data: bytes) -> Iterable[tuple[int, Any]]:
    """(tag, raw value) of each field; raises SchemaError, IndexError. One-byte varints, most, are read in place."""
    at, end = 0, len(data)
    while at < end:
        tag = data[at]
        at += 1
        if tag > 0x7F:
            tag, at = _read_varint(data, at - 1)
        wire = tag & 7
        if wire == _FIXED64:
            size = 8
        elif wire == FIXED32:
            size = 4
        elif wire in (BYTES, VARINT):
            size = data[at]
            at += 1
            if size > 0x7F:
                size, at = _read_varint(data, at - 1)
            if wire == VARINT:
                yield tag, size
                continue
        else:
            raise SchemaError(f"wire type {wire}")
        stop = at + size
        if stop > end:
            raise SchemaError("ends inside a field")
        yield tag, data[at:stop]
        at = stop


def _fields_of(message: type) -> list[Field]:
    hints = get_type_hints(message, include_extras=True)
    fields = []
    for number, field in enumerate(dataclasses.fields(message), start=1):
        hint, optional = _without_none(hints[field.name])
        kind = _kind(hint)
        if kind is None:
            raise TypeError(f"{message.__name__}.{field.name}: no Protobuf type for {hint}")
        default = kind.default if field.default is dataclasses.MISSING else field.default
        fields.append(Field(field.name, number, kind, optional, default))
    return fields


def _without_none(hint: Any) -> tuple[Any, bool]:
    if get_origin(hint) in (Union, types.UnionType):
        others = [part for part in get_args(hint) if part is not type(None)]
        if len(others) == 1:
            return others[0], True
    return hint, False


def _kind(hint: Any) -> Kind | None:
    if get_origin(hint) is Annotated:
        return _array_kind(hint)
    if hint == tuple[str, ...]:
        return Kind(Proto.TYPE_STRING, BYTES, _texts_encoder, bytes.decode, (), repeated=True, many=True)
    if isinstance(hint, type) and issubclass(hint, StrEnum):
        return Kind(Proto.TYPE_STRING, BYTES, _text_encoder, lambda raw: hint(raw.decode()), next(iter(hint)))
    if isinstance(hint, type) and issubclass(hint, IntEnum):
        return Kind(Proto.TYPE_ENUM, VARINT, _varint_encoder, hint, next(iter(hint)), enum=hint)
    return _SCALARS.get(hint)


def _varint_encoder(tag: bytes) -> Callable[[int], bytes]:
    return lambda value: tag + varint(value)


def _number_encoder(code: str) -> Callable[[bytes], Callable[[Any], bytes]]:
    """For a number that `struct` knows by its code: one call packs the tag with it."""
    return lambda tag: partial(struct.Struct(f"<{len(tag)}s{code}").pack, tag)


def _bytes_encoder(tag: bytes) -> Callable[[bytes], bytes]:
    return lambda value: tag + _sized(value)


def _text_encoder(tag: bytes) -> Callable[[str], bytes]:
    return lambda value: tag + _sized(value.encode())


def _texts_encoder(tag: bytes) -> Callable[[tuple[str, ...]], bytes]:
    return lambda values: b"".join([tag + _sized(value.encode()) for value in values])


_SCALARS: dict[type, Kind] = {
    bool: Kind(Proto.TYPE_BOOL, VARINT, _number_encoder("?"), bool, False),
    int: Kind(
        Proto.TYPE_SFIXED64, _FIXED64, _number_encoder("q"), lambda raw: _SFIXED64.unpack(raw)[0], 0, Numbers("<i8")
    ),
    float: Kind(
        Proto.TYPE_DOUBLE, _FIXED64, _number_encoder("d"), lambda raw: _DOUBLE.unpack(raw)[0], 0.0, Numbers("<f8")
    ),
    str: Kind(Proto.TYPE_STRING, BYTES, _text_encoder, bytes.decode, ""),
    bytes: Kind(Proto.TYPE_BYTES, BYTES, _bytes_encoder, bytes, b"", Numbers("u1", (-1,))),
}


def _array_kind(hint: Any) -> Kind | None:
    from formation.maths.arrays import Layout

    layout = next((note for note in get_args(hint)[1:] if isinstance(note, Layout)), None)
    if layout is None:
        return None
    exact = _packed_kind(layout.scalar, layout.shape, layout.scalar)
    if not layout.is_single:
        return exact
    return dataclasses.replace(_packed_kind(layout.scalar, layout.shape, "f4"), older=exact)


def _packed_kind(scalar: Any, shape: tuple[int, ...], stored: Any) -> Kind:
    """Arrays of `scalar` and that shape, each number packed as `stored`."""
    import numpy as np

    dtype, tail = np.dtype(scalar), shape[1:]
    wire_dtype = np.dtype(stored).newbyteorder("<")
    is_same = wire_dtype == dtype.newbyteorder("<")
    read_dtype = np.dtype(np.uint8) if dtype == np.bool_ else wire_dtype  # any byte but zero is true

    def encoder(tag: bytes) -> Callable[["np.ndarray[Any, Any]"], bytes]:
        heads: dict[tuple[int, ...], bytes] = {}  # tag and length for each shape met, all of them right

        def encode(value: "np.ndarray[Any, Any]") -> bytes:
            head = heads.get(value.shape)
            if head is None or value.dtype != dtype:
                if value.dtype != dtype or value.shape[1:] != tail or value.ndim != len(shape):
                    raise ValueError(f"an array of {value.dtype} {value.shape}, not {dtype} {shape}")
                head = heads[value.shape] = tag + varint(value.size * wire_dtype.itemsize)
            return head + (value if is_same else value.astype(wire_dtype)).tobytes()

        return encode

    def decode(raw: bytes) -> "np.ndarray[Any, Any]":
        # A copy: an array that can be written to, as every other can.
        with np.errstate(invalid="ignore"):  # a signalling NaN becomes a quiet one
            flat = np.frombuffer(raw, read_dtype).astype(dtype)
        return flat if shape == (-1,) else flat.reshape(shape)

    proto = {"?": Proto.TYPE_BOOL, "B": Proto.TYPE_BYTES, "f": Proto.TYPE_FLOAT}.get(wire_dtype.char, Proto.TYPE_DOUBLE)
    return Kind(
        proto=proto,
        wire=BYTES,
        encoder=encoder,
        decode=decode,
        default=np.zeros(tuple(max(0, size) for size in shape), dtype),
        numbers=Numbers(read_dtype, shape, dtype == np.bool_),
        repeated=proto is not Proto.TYPE_BYTES,
    )
