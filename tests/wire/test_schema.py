"""The derived Protobuf schemas against Google's own implementation."""

import dataclasses
import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from hypothesis import given
from hypothesis import strategies as st

from formation import topics
from formation.maths.arrays import Scalars, SingleVec3s, Vec3s
from tests.wire.spine import SPINE, assert_identical
from wire.schema import Schema, SchemaError, schema_of


def googles(schema: Schema):
    """The message class that Protobuf's own implementation makes of our descriptor."""
    files = descriptor_pb2.FileDescriptorSet.FromString(schema.descriptor_set)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))


def test_every_topic_has_a_strategy():
    assert set(SPINE) == {topic.type for topic in topics.ALL}


@pytest.mark.parametrize("kind", SPINE, ids=lambda kind: kind.__name__)
def test_every_value_comes_back_bit_for_bit_and_protobufs_own_implementation_agrees_both_ways(kind):
    schema = schema_of(kind)
    theirs = googles(schema)

    @given(SPINE[kind])
    def check(message):
        data = schema.encode(message)
        assert_identical(message, schema.decode(data))
        read = theirs.FromString(data)
        for field in dataclasses.fields(message):
            ours, value = getattr(message, field.name), getattr(read, field.name)
            if isinstance(value, bytes) and isinstance(ours, np.ndarray):
                np.testing.assert_array_equal(np.frombuffer(value, np.uint8), ours)
            elif isinstance(ours, np.ndarray):
                np.testing.assert_array_equal(np.array(value, dtype=ours.dtype), ours.ravel())
            elif isinstance(ours, tuple):
                assert tuple(value) == ours
            else:
                assert value == ours or math.isnan(value)
        assert_identical(message, schema.decode(read.SerializeToString()))

    check()


@given(st.data())
def test_any_bytes_and_any_beginning_of_a_message_are_a_message_or_the_one_error(data):
    kind = data.draw(st.sampled_from(sorted(SPINE, key=lambda kind: kind.__name__)))
    encoded = schema_of(kind).encode(data.draw(SPINE[kind]))
    try:
        message = schema_of(kind).decode(
            data.draw(st.binary(max_size=200) | st.integers(0, len(encoded)).map(lambda n: encoded[:n]))
        )
    except SchemaError:
        return
    assert type(message) is kind


class Colour(IntEnum):
    RED = 1
    BLUE = 2


@dataclass(frozen=True, slots=True, eq=False)
class First:
    """A message as an older version knew it."""

    a: int
    gone: float
    v: Vec3s


@dataclass(frozen=True, slots=True, eq=False)
class Second:
    """The same with a field gone, one before the others, one with a default and one that may be absent."""

    new: str
    v: Vec3s
    a: int
    colour: Colour = Colour.BLUE
    maybe: float | None = None
    s: Scalars = dataclasses.field(default_factory=lambda: np.zeros(0))


def test_a_log_of_an_older_version_is_read_by_the_names_of_its_fields():
    old = Schema(First)
    renamed = Schema(Second)
    files = descriptor_pb2.FileDescriptorSet.FromString(old.descriptor_set)
    files.file[0].message_type[0].name = "Second"
    vectors = np.arange(6.0).reshape(2, 3)
    written = renamed.written(files.SerializeToString())
    read = written.decode(old.encode(First(7, 1.5, vectors)))
    assert (read.a, read.new, read.colour, read.maybe) == (7, "", Colour.BLUE, None)
    np.testing.assert_array_equal(read.v, vectors)
    assert written.left_out == {"new", "colour", "maybe", "s"}
    assert renamed.written(renamed.descriptor_set).left_out == frozenset()


@dataclass(frozen=True, slots=True, eq=False)
class Third:
    """The same, which a log holds in single precision since."""

    a: int
    v: SingleVec3s


def test_arrays_in_single_precision_are_read_as_they_were_written_before_and_since():
    now, before = Schema(Third), Schema(First)
    vectors = np.array([[0.1, -2.5, 1e30], [np.inf, -np.inf, 0.0]])
    data = now.encode(Third(7, vectors))
    assert len(data) < len(before.encode(First(7, 1.5, vectors))) - 4 * vectors.size
    np.testing.assert_array_equal(now.decode(data).v, vectors.astype(np.float32))
    assert now.decode(data).v.dtype == np.float64
    files = descriptor_pb2.FileDescriptorSet.FromString(before.descriptor_set)
    files.file[0].message_type[0].name = "Third"
    read = now.written(files.SerializeToString()).decode(before.encode(First(7, 1.5, vectors)))
    np.testing.assert_array_equal(read.v, vectors)


def test_a_schema_that_is_none_is_the_one_error():
    for data in (b"\xff\xff\xff", b"", Schema(First).descriptor_set):
        with pytest.raises(SchemaError):
            Schema(Second).written(data)


def test_an_absent_value_stays_absent():
    schema = Schema(Second)
    message = Second("x", np.zeros((1, 3)), 1, Colour.RED, None, np.ones(2))
    assert schema.decode(schema.encode(message)).maybe is None
    assert schema.decode(schema.encode(dataclasses.replace(message, maybe=0.0))).maybe == 0.0


@pytest.mark.parametrize("array", [np.zeros((3, 2)), np.zeros(3), np.zeros((1, 3), np.float32), np.zeros((1, 1, 3))])
def test_an_array_of_another_shape_or_type_is_refused(array):
    with pytest.raises(ValueError, match="an array of"):
        Schema(First).encode(First(1, 2.0, array))


def test_a_type_without_a_schema_is_named():
    @dataclass
    class Odd:
        where: complex

    with pytest.raises(TypeError, match=r"Odd\.where"):
        Schema(Odd)
