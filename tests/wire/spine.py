"""Random messages of the spine, one strategy a topic's type, and their bit-for-bit comparison."""

import dataclasses
from collections.abc import Sequence
from enum import Enum
from typing import Any, get_args, get_type_hints

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as stn

from formation import topics
from wire.columns import Column

_INTS = st.integers(-(2**63), 2**63 - 1)


def _values(hint: Any, count: int) -> st.SearchStrategy[Any]:
    """Anything the annotation allows, with `count` vehicles."""
    if hasattr(hint, "__metadata__"):
        layout = get_args(hint)[1]
        shape = tuple(count if size < 0 else size for size in layout.shape)
        if layout.is_single:  # what single precision can hold
            return stn.arrays(np.float32, shape).map(lambda array: array.astype(np.float64))
        return stn.arrays(layout.scalar, shape)
    if hint == tuple[str, ...]:
        return st.lists(st.text(max_size=8), min_size=count, max_size=count).map(tuple)
    if isinstance(hint, type) and issubclass(hint, Enum):
        return st.sampled_from(hint)
    return {int: _INTS, float: st.floats(), bool: st.booleans(), str: st.text(), bytes: st.binary()}[hint]


def messages(kind: type) -> st.SearchStrategy[Any]:
    """Any message of one dataclass."""
    hints = get_type_hints(kind, include_extras=True)
    names = [field.name for field in dataclasses.fields(kind)]
    return st.integers(0, 4).flatmap(
        lambda count: st.builds(kind, **{name: _values(hints[name], count) for name in names})
    )


SPINE = {topic.type: messages(topic.type) for topic in topics.ALL}


def assert_identical(ours: Any, theirs: Any) -> None:
    """Equal field by field, floats by their bits."""
    assert type(ours) is type(theirs)
    for field in dataclasses.fields(ours):
        a, b = getattr(ours, field.name), getattr(theirs, field.name)
        if isinstance(a, np.ndarray):
            assert (a.dtype, a.shape, a.tobytes()) == (b.dtype, b.shape, b.tobytes()), field.name
        elif isinstance(a, float):
            assert np.float64(a).tobytes() == np.float64(b).tobytes(), field.name
        else:
            assert type(a) is type(b), field.name
            assert a == b, field.name


def value_of(column: Column, k: int) -> Any:
    if column.counts is None:
        return column.values[k]
    stop = int(column.counts[: k + 1].sum())
    return column.values[stop - int(column.counts[k]) : stop]


def assert_column(column: Column, messages: Sequence[Any], name: str) -> None:
    """A column against its messages, bit for bit; single precision as double."""
    for k, message in enumerate(messages):
        ours, theirs = value_of(column, k), getattr(message, name)
        if isinstance(theirs, bytes):
            assert ours.tobytes() == theirs
        elif isinstance(theirs, np.ndarray | float):
            wanted = np.asarray(theirs)
            assert ours.shape == wanted.shape, name
            assert ours.astype(wanted.dtype).tobytes() == wanted.tobytes(), name
        else:
            assert ours == theirs, name
            assert column.values.dtype != object or type(ours) is type(theirs), name
