"""Columns against the decoder: whatever the messages, both read the same."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from google.protobuf import descriptor_pb2
from hypothesis import given
from hypothesis import strategies as st

from formation import messages as m
from formation.maths.frames import IDENTITY
from tests.wire.spine import SPINE, assert_column, value_of
from wire.columns import Column, Gathered, Stacked, joined
from wire.schema import SchemaError, Written, schema_of


def gathered(written: Written[Any], data: Sequence[bytes]) -> Gathered:
    """Of messages end to end, as a log has them."""
    lengths = np.array([len(each) for each in data])
    found = Gathered([field.name for field in dataclasses.fields(written.message)])
    whole = np.frombuffer(b"".join(data), np.uint8)
    found.receive(written, whole, np.arange(len(data)), np.cumsum(lengths) - lengths, lengths)
    return found


def assert_both_ways(written: Written[Any], data: Sequence[bytes]) -> None:
    """What the decoder reads of each, and what it rejects."""
    decoded, rejected = {}, {}
    for k, each in enumerate(data):
        try:
            decoded[k] = written.decode(each)
        except SchemaError as error:
            rejected[k] = str(error)
    found = gathered(written, data)
    places, columns = found.columns()
    assert {place: str(error) for place, error in found.errors} == rejected
    assert places.tolist() == list(decoded)
    for name, column in columns.items():
        assert_column(column, list(decoded.values()), name)


def lists(kind: type) -> st.SearchStrategy[list[Any]]:
    """Messages of one type, some of them laid out alike."""
    return st.lists(SPINE[kind], min_size=1, max_size=4).map(lambda some: [*some, *some[::-1], some[0]])


@pytest.mark.parametrize("kind", SPINE, ids=lambda kind: kind.__name__)
def test_columns_hold_what_the_decoder_reads(kind):
    schema = schema_of(kind)

    @given(lists(kind))
    def check(messages):
        assert_both_ways(schema.own, [schema.encode(message) for message in messages])
        for name, column in Stacked(messages).items():
            assert_column(column, messages, name)

    check()


@given(st.data())
def test_bytes_that_are_altered_read_as_the_decoder_reads_them(data):
    kind = data.draw(st.sampled_from(sorted(SPINE, key=lambda kind: kind.__name__)))
    encoded = [schema_of(kind).encode(message) for message in data.draw(lists(kind))]
    for _ in range(3):
        k = data.draw(st.integers(0, len(encoded) - 1))
        altered = bytearray(encoded[k])
        if altered:
            altered[data.draw(st.integers(0, len(altered) - 1))] ^= data.draw(st.integers(1, 255))
        encoded[k] = (
            bytes(altered)[: data.draw(st.integers(0, len(altered)))] if data.draw(st.booleans()) else bytes(altered)
        )
    assert_both_ways(schema_of(kind).own, [*encoded, data.draw(st.binary(max_size=40))])


def test_a_log_of_before_a_field_was_recorded_has_its_default():
    """Rejections of poses: a frame without any gets as many as it has bodies."""
    schema = schema_of(m.LabFrame)
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.descriptor_set)
    fields = files.file[0].message_type[0].field
    del fields[[field.name for field in fields].index("rejected")]
    written = schema.written(files.SerializeToString())
    frames = [
        m.LabFrame(k, k, ("a", "b"), np.zeros((2, 3)), np.tile(IDENTITY, (2, 1)), np.ones(2, bool)) for k in range(3)
    ]
    assert_both_ways(written, [schema.encode(frame) for frame in frames])
    _, columns = gathered(written, [schema.encode(frame) for frame in frames]).columns()
    np.testing.assert_array_equal(columns["rejected"].stack(), np.zeros((3, 2)))


def test_pieces_of_a_log_are_joined_whatever_their_arrays_lengths():
    of_two, of_three = Column(np.arange(4.0).reshape(2, 2)), Column(np.arange(3.0)[None])
    ragged = joined([of_two, of_three, of_two])
    assert [value_of(ragged, k).tolist() for k in range(5)] == [[0, 1], [2, 3], [0, 1, 2], [0, 1], [2, 3]]
    with pytest.raises(ValueError, match="arrays of 2 and of other lengths"):
        ragged.stack()
    kept = ragged.where(ragged.of_length(2))
    np.testing.assert_array_equal(kept.stack(), [[0, 1], [2, 3], [0, 1], [2, 3]])
    np.testing.assert_array_equal(joined([of_two, of_two]).values, [[0, 1], [2, 3], [0, 1], [2, 3]])
