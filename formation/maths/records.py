"""Rows of named numbers: what kernels take and return instead of dozens of arrays.

A record is a dataclass of floats, ints, flags, arrays of a fixed shape and other records. `rows` lays several out as
one structured array of numpy: `several[i].name` reads and writes one's field, in a compiled loop and in plain Python
alike, and `several["name"]` is that field of all. Passing one structured array to a kernel costs what passing one
array costs, and no two fields can be swapped.
"""

from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from typing import Annotated, Any, Protocol, TypeVar, get_args, get_origin, get_type_hints, overload

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Layout

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)


class Rows(Protocol[T_co]):
    """A structured array of records T, as `rows` and `blank` make it."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """The layout of each."""

    def __len__(self) -> int: ...

    def tobytes(self) -> bytes:
        """All of them, end to end."""

    @overload
    def __getitem__(self, index: int) -> T_co: ...

    @overload
    def __getitem__(self, index: str) -> NDArray[Any]: ...

    def __setitem__(self, index: int | str, value: object) -> None: ...


def rows(cls: type[T], items: Sequence[T]) -> Rows[T]:
    """The items as one structured array."""
    out = blank(cls, len(items))
    for i, item in enumerate(items):
        out[i] = _values(item)
    return out


def blank(cls: type[T], count: int) -> Rows[T]:
    """That many records, all zero."""
    dtype = dtype_of(cls)
    return _laid_out(bytearray(count * dtype.itemsize), dtype)


def like(some: Rows[T]) -> Rows[T]:
    """As many records of that kind, all zero."""
    out: Any = np.ndarray(len(some), some.dtype, bytearray(len(some) * some.dtype.itemsize))
    made: Rows[T] = out
    return made


def copied(some: Rows[T]) -> Rows[T]:
    """The same records, of their own."""
    return _laid_out(bytearray(some.tobytes()), some.dtype)


def chosen(some: Rows[T], which: NDArray[np.bool_]) -> Rows[T]:
    """Those of the records whose flag (n,) is set, of their own."""
    each = np.asarray(some)[which]
    return _laid_out(bytearray(each.tobytes()), some.dtype)


def _laid_out(memory: bytearray, dtype: np.dtype[Any]) -> Rows[Any]:
    """Records in that memory. (np.zeros looks at every field to learn how to clear it: five times as long.)"""
    out: Any = np.ndarray(len(memory) // dtype.itemsize, dtype, memory)
    made: Rows[Any] = out
    return made


def dtype_of(cls: Any) -> np.dtype[Any]:
    """The layout of a record: 64-bit numbers and flags, aligned, in the order of its fields. TypeError for others."""
    return _record(cls)


@cache
def _record(cls: Any) -> np.dtype[Any]:
    return np.dtype((np.record, _struct(cls)))


@cache
def _struct(cls: Any) -> np.dtype[Any]:
    """The same without np.record, which would lose the alignment of a record inside another."""
    hints = get_type_hints(cls, include_extras=True)
    return np.dtype([(f.name, *_layout(cls, f.name, hints[f.name])) for f in fields(cls)], align=True)


def _layout(cls: Any, name: str, kind: Any) -> tuple[Any, ...]:
    """Scalar type, and shape if it is an array's, of one field."""
    if hasattr(np.record, name):
        raise TypeError(f"{cls.__name__}.{name}: numpy's own records have an attribute of that name")
    if get_origin(kind) is Annotated:
        array = next(extra for extra in get_args(kind) if isinstance(extra, Layout))
        return np.dtype(array.scalar), array.shape
    if isinstance(kind, type):
        for plain, scalar in ((bool, np.bool_), (int, np.int64), (float, np.float64)):
            if issubclass(kind, plain):
                return (np.dtype(scalar),)
        if hasattr(kind, "__dataclass_fields__"):
            return (_struct(kind),)
    raise TypeError(f"{cls.__name__}.{name}: {kind} cannot be part of a record")


def _values(item: Any) -> Any:
    """A record's fields as numpy takes them: a tuple, nested where it holds records."""
    if not hasattr(item, "__dataclass_fields__"):
        return item
    return tuple(_values(getattr(item, f.name)) for f in fields(item))
