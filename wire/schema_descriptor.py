"""A schema in Protobuf's own words: the descriptor that lies with the data, for readers that know nothing of us."""

from collections.abc import Sequence
from enum import IntEnum
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:  # not loaded before a log is written or read
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


class Kind(Protocol):
    """What of a field's type the descriptor says."""

    @property
    def proto(self) -> int:
        """Its Protobuf type."""

    @property
    def repeated(self) -> bool:
        """Whether there are several."""

    @property
    def enum(self) -> type[IntEnum] | None:
        """Its values, where it is an enumeration."""


class Field(Protocol):
    """What of a field the descriptor says."""

    @property
    def name(self) -> str:
        """Its name."""

    @property
    def number(self) -> int:
        """Its number."""

    @property
    def kind(self) -> Kind:
        """Its type."""


def described(name: str, fields: Sequence[Field]) -> "descriptor_pb2.FileDescriptorSet":
    """The FileDescriptorSet of one message of these fields."""
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
