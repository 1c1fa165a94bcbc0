"""Messages of one type as columns: an array a field. Most of a topic's messages are read without one being decoded.

Of messages of one length nearly all are laid out as the first: the same tags and lengths at the same places, as one
comparison of all shows. Their fields are then columns of one table of bytes. What is laid out otherwise is decoded.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from formation.maths.arrays import Bool
from wire.schema import BYTES, VARINT, Field, SchemaError, Written, tagged, varint

Index = NDArray[np.int64]
Bytes = NDArray[np.uint8]
Values = NDArray[Any]


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One field of T messages, in order: numbers as they are stored; of `bytes` uint8; all else as objects.

    values: (T, ...). Where messages hold arrays of several lengths these are in `counts` (T,), and `values` has the
    arrays end to end, (sum(counts), ...).
    """

    values: Values
    counts: Index | None = None

    def flat(self) -> tuple[Values, Index]:
        """Of arrays: all end to end, and the length of each."""
        if self.counts is not None:
            return self.values, self.counts
        count, length, *rest = self.values.shape
        return self.values.reshape(count * length, *rest), np.full(count, length)

    def of_length(self, length: int) -> Bool:
        """(T,): whose arrays have that length."""
        return np.equal(self.flat()[1], length)

    def where(self, chosen: Bool) -> "Column":
        """That of some of the messages; chosen (T,)."""
        if self.counts is None:
            return Column(self.values[chosen])
        return Column(self.values[np.repeat(chosen, self.counts)], self.counts[chosen])

    def stack(self) -> Values:
        """(T, ...), of arrays as long as the first; ValueError where others are not."""
        if self.counts is None:
            return self.values
        length = int(self.counts[0]) if len(self.counts) else 0
        if (self.counts != length).any():
            raise ValueError(f"arrays of {length} and of other lengths")
        return self.values.reshape(len(self.counts), length, *self.values.shape[1:])

    def pieces(self) -> list[bytes]:
        """Of `bytes`: those of each message."""
        values, counts = self.flat()
        whole, stops = values.tobytes(), np.cumsum(counts).tolist()
        return [whole[start:stop] for start, stop in zip([0, *stops], stops, strict=False)]


class Stacked(Mapping[str, Column]):
    """The columns of messages in memory, each made when it is looked at."""

    def __init__(self, messages: Sequence[Any]) -> None:
        self._messages = messages

    def __getitem__(self, name: str) -> Column:
        return stacked([getattr(message, name) for message in self._messages])

    def __iter__(self) -> Iterator[str]:
        return iter(field.name for field in fields(self._messages[0]))

    def __len__(self) -> int:
        return len(fields(self._messages[0]))


def joined(columns: Sequence[Column]) -> Column:
    """Columns of one field end to end; one at least."""
    if len(columns) == 1:
        return columns[0]
    if all(c.counts is None for c in columns) and len({c.values.shape[1:] for c in columns}) == 1:
        return Column(np.concatenate([c.values for c in columns]))
    flat = [column.flat() for column in columns]
    return Column(np.concatenate([values for values, _ in flat]), np.concatenate([counts for _, counts in flat]))


def stacked(values: Sequence[Any]) -> Column:
    """One field of messages, one at least."""
    first = values[0]
    if isinstance(first, bytes):
        return _of_arrays([np.frombuffer(value, np.uint8) for value in values])
    if isinstance(first, np.ndarray):
        return _of_arrays(values)
    if isinstance(first, int | float) and not isinstance(first, Enum) and None not in values:
        return Column(np.array(values))
    return Column(_objects(values))


def _of_arrays(arrays: Sequence[Values]) -> Column:
    if len({array.shape for array in arrays}) == 1:
        return Column(np.array(arrays))
    return Column(np.concatenate(arrays), np.array([len(array) for array in arrays]))


def _objects(values: Sequence[Any]) -> Values:
    column = np.empty(len(values), dtype=object)
    for k, value in enumerate(values):  # numpy would take a tuple apart
        column[k] = value
    return column


def windows(data: Bytes, width: int) -> NDArray[np.void]:
    """Every run of `width` bytes, one at least, to be gathered or filled by index: item k begins at byte k."""
    return np.ndarray(max(len(data) - width + 1, 0), f"V{width}", data, strides=(1,))


class Gathered:
    """The messages of one topic in one piece of a log, being gathered."""

    def __init__(self, names: Collection[str]) -> None:
        """names: of the fields that are wanted; all messages are checked."""
        self.errors: list[tuple[int, SchemaError]] = []
        """The indices of what holds no message, and why."""
        self._names = names
        self._indices: list[Index] = []
        self._parts: list[dict[str, Values]] = []

    def receive(self, written: Written[Any], data: Bytes, indices: Index, starts: Index, lengths: Index) -> None:
        """Receive messages of one version: the index of each in its topic, where in `data` it starts, its length."""
        for length in np.unique(lengths).tolist():
            at = np.flatnonzero(lengths == length)
            rows = np.zeros((len(at), 0), np.uint8)
            if length:
                rows = windows(data, length)[starts[at]].view(np.uint8).reshape(-1, length)
            alike, part = _read(written, rows, self._names)
            if alike.any():
                self._indices.append(indices[at[alike]])
                self._parts.append(part)
            for k in np.flatnonzero(~alike).tolist():
                self._decode(written, int(indices[at[k]]), rows[k].tobytes())

    def _decode(self, written: Written[Any], index: int, message: bytes) -> None:
        try:
            decoded = written.decode(message)
        except SchemaError as error:
            self.errors.append((index, error))
            return
        self._indices.append(np.array([index]))
        self._parts.append({name: stacked([getattr(decoded, name)]).values for name in self._names})

    def columns(self) -> tuple[Index, dict[str, Column]]:
        """The indices of those that could be read, in order, and their columns."""
        if not self._indices:
            return np.zeros(0, np.int64), {}
        indices = np.concatenate(self._indices)
        read = np.sort(indices)
        ranks = [np.searchsorted(read, part) for part in self._indices]
        return read, {name: _in_order(ranks, [part[name] for part in self._parts]) for name in self._names}


def _in_order(ranks: Sequence[Index], parts: Sequence[Values]) -> Column:
    """One column of parts, each of arrays of one length; ranks: the place of each row in the column."""
    if len(parts) == 1:
        return Column(parts[0])
    total = sum(map(len, parts))
    dtype = np.result_type(*{part.dtype for part in parts})
    if len({part.shape[1:] for part in parts}) == 1:
        values = np.empty((total, *parts[0].shape[1:]), dtype)
        for rank, part in zip(ranks, parts, strict=True):
            values[rank] = part
        return Column(values)
    counts = np.empty(total, np.int64)
    for rank, part in zip(ranks, parts, strict=True):
        counts[rank] = part.shape[1]
    starts = np.cumsum(counts) - counts
    flat = np.empty((int(counts.sum()), *parts[0].shape[2:]), dtype)
    item = dtype.itemsize * int(np.prod(flat.shape[1:]))
    data = flat.reshape(-1).view(np.uint8)
    for rank, part in zip(ranks, parts, strict=True):
        width = item * part.shape[1]
        if width:
            rows = np.ascontiguousarray(part, dtype).reshape(len(part), -1)
            windows(data, width)[item * starts[rank]] = rows.view(f"V{width}")[:, 0]
    return Column(flat, counts)


@dataclass(frozen=True, slots=True)
class _Layout:
    """Where in a message its fields lie. fixed (L,): the bytes that are tags and lengths; varints: one-byte values."""

    fields: Mapping[str, tuple[Field, list[slice]]]
    fixed: Bool
    varints: list[int]


def _layout(written: Written[Any], message: bytes) -> _Layout | None:
    """Raises as `wire.schema.tagged`; None where numbers are not written in their shortest way, or in several bytes."""
    found: dict[str, tuple[Field, list[slice]]] = {}
    fixed, varints = np.ones(len(message), np.bool_), list[int]()
    at = 0
    for tag, raw in tagged(message):
        kind = tag & 7
        at += len(varint(tag)) + (len(varint(len(raw))) if kind == BYTES else 0)
        stop = at + (1 if kind == VARINT else len(raw))
        if kind == VARINT:
            if raw > 0x7F:
                return None
            varints.append(at)
        fixed[at:stop] = False
        field = written.by_tag.get(tag)
        if field is not None:
            slices = found.setdefault(field.name, (field, []))[1]
            if not field.kind.many:
                slices.clear()
            slices.append(slice(at, stop))
        at = stop
    return _Layout(found, fixed, varints) if at == len(message) else None


def _read(written: Written[Any], rows: Bytes, names: Collection[str]) -> tuple[Bool, dict[str, Values]]:
    """Which of the messages (R, L) are laid out as the first, and hold what they may; and of those the columns."""
    none = np.zeros(len(rows), np.bool_), dict[str, Values]()
    try:
        first = written.decode(rows[0].tobytes())
        layout = _layout(written, rows[0].tobytes())
    except SchemaError:
        return none
    if layout is None:
        return none
    alike: Bool = (rows[:, layout.fixed] == rows[0, layout.fixed]).all(axis=1)
    alike &= (rows[:, layout.varints] < 0x80).all(axis=1)
    texts = {}
    for name, (field, slices) in layout.fields.items():
        if field.kind.numbers is None and field.kind.decode is not bool:
            texts[name], good = _texts(field, slices, rows)
            alike &= good
    chosen = slice(None) if alike.all() else alike
    part = {}
    for name in names:
        if name in texts:
            part[name] = texts[name][chosen]
        elif name in layout.fields:
            field, slices = layout.fields[name]
            part[name] = _numbers(field, rows[chosen, slices[-1]], getattr(first, name))
        else:
            part[name] = np.repeat(stacked([getattr(first, name)]).values, int(alike.sum()), axis=0)
    return alike, part


def _texts(field: Field, slices: Sequence[slice], rows: Bytes) -> tuple[Values, Bool]:
    """What is decoded to an object (text, texts, enumeration) of each message (R,), and whether it is one.

    Each distinct one is decoded once.
    """
    raw = np.ascontiguousarray(rows[:, slices[0].start : slices[-1].stop])
    firsts, which = np.zeros(1, np.int64), np.zeros(len(rows), np.int64)
    if (raw != raw[0]).any():
        _, firsts, which = np.unique(raw.view(f"S{raw.shape[1]}")[:, 0], return_index=True, return_inverse=True)
    values, good = np.empty(len(firsts), dtype=object), np.ones(len(firsts), np.bool_)
    for k, row in enumerate(firsts.tolist()):
        try:
            values[k] = _decoded(field, [rows[row, each] for each in slices])
        except ValueError:
            good[k] = False
    return values[which], good[which]


def _decoded(field: Field, raw: Sequence[Bytes]) -> Any:
    if field.kind.wire == VARINT:
        return field.kind.decode(int(raw[0][0]))
    items = [field.kind.decode(each.tobytes()) for each in raw]
    return tuple(items) if field.kind.many else items[0]


def _numbers(field: Field, raw: Bytes, first: Any) -> Values:
    """The numbers (R, ...) in the fields' bytes (R, W). first: the first message's, which all without bytes have."""
    numbers = field.kind.numbers
    if numbers is None:
        return np.not_equal(raw[:, 0], 0)
    if not raw.shape[1]:
        return np.repeat(stacked([first]).values, len(raw), axis=0)
    values: Values = np.ascontiguousarray(raw).view(numbers.stored).reshape(len(raw), *numbers.shape)
    return values.astype(np.bool_) if numbers.is_flags else values
