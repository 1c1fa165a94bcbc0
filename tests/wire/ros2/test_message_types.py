"""ROS 2's messages against `rosbags`, which has the types of every distribution, and made by hand."""

import struct
from contextlib import suppress
from itertools import chain, count

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from wire.ros2.message_types import CdrError, message_type

DISTRIBUTIONS = (Stores.ROS2_HUMBLE, Stores.ROS2_IRON, Stores.ROS2_JAZZY, Stores.ROS2_KILTED)
STANDARD = (
    "builtin_interfaces/msg/Time", "std_msgs/msg/Header", "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/Vector3Stamped", "nav_msgs/msg/Odometry", "tf2_msgs/msg/TFMessage",
    "diagnostic_msgs/msg/DiagnosticArray", "sensor_msgs/msg/BatteryState",
)  # fmt: skip
POSES = "motion_capture_tracking_interfaces/msg/NamedPoseArray"


def with_poses(store: Typestore) -> Typestore:
    """The store with motion_capture_tracking's messages, as its own package defines them."""
    package = "motion_capture_tracking_interfaces/msg"
    store.register(get_types_from_msg("string name\ngeometry_msgs/Pose pose\n", f"{package}/NamedPose"))
    store.register(get_types_from_msg("string source\nuint32 latency # us\n", f"{package}/LatencyInfo"))
    store.register(get_types_from_msg("std_msgs/Header header\nNamedPose[] poses\n", f"{package}/NamedPoseArray"))
    second = "std_msgs/Header header\nuint64 timestamp\nLatencyInfo[] latencies\nNamedPose[] poses\n"
    store.register(get_types_from_msg(second, f"{package}/NamedPoseArrayV2"))
    return store


def example(store: Typestore, name: str, numbers: count) -> tuple:
    """A message of that type by the oracle, and the same as our flat tuple; every value another, every text longer."""
    ours, theirs = [], {}
    for field, (node, described) in store.fielddefs[name][1]:
        if node == Nodetype.BASE:
            value = _single(described[0], numbers)
            theirs[field] = value
            ours.append(value)
        elif node == Nodetype.NAME:
            inner, theirs[field] = example(store, described, numbers)
            ours += inner
        else:
            (kind, item), size = described
            rows = [
                ((_single(item[0], numbers),) * 2 if kind == Nodetype.BASE else example(store, item, numbers))
                for _ in range(size or 3)
            ]
            theirs[field] = [row[1] for row in rows]
            if kind == Nodetype.BASE:
                theirs[field] = np.array(theirs[field], item[0])
                rows = [((row[0],), row[1]) for row in rows]
            ours += (
                chain.from_iterable(row[0] for row in rows)
                if node == Nodetype.ARRAY
                else [tuple(row[0] for row in rows)]
            )
    return tuple(ours), store.types[name](**theirs)


def _single(kind: str, numbers: count) -> object:
    number = next(numbers)
    if kind == "string":
        return "ä" + "x" * number
    return bool(number % 2) if kind == "bool" else number + 0.5 if kind.startswith("float") else number


@pytest.mark.parametrize("distribution", DISTRIBUTIONS)
@pytest.mark.parametrize("name", [*STANDARD, POSES, f"{POSES}V2"])
def test_hash_and_cdr_are_those_of_every_distribution(name: str, distribution: Stores) -> None:
    store, ours = with_poses(get_typestore(distribution)), message_type(name)
    assert ours.hash == store.hash_rihs01(name)
    for start in range(8):  # texts of every length modulo eight shift what follows
        values, message = example(store, name, count(start))
        cdr = bytes(store.serialize_cdr(message, name, little_endian=True))
        assert ours.encode(values) == cdr
        assert ours.decode(cdr) == values


@pytest.mark.parametrize("name", [*STANDARD, POSES, f"{POSES}V2"])
def test_definition_is_read_by_others_as_the_same_type(name: str) -> None:
    store = get_typestore(Stores.EMPTY)
    types = get_types_from_msg(message_type(name).definition, name)
    store.register({key: value for key, value in types.items() if not key.startswith("builtin_interfaces")})
    assert store.hash_rihs01(name) == message_type(name).hash


def test_service_has_the_hash_and_the_empty_request_of_ros() -> None:
    # std_srvs/srv/Trigger of Jazzy, as `ros2 service info` and rmw_zenoh's keys have it.
    assert message_type("std_srvs/srv/Trigger").hash == (
        "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
    )
    assert message_type("std_srvs/srv/Trigger").dds_name == "std_srvs::srv::dds_::Trigger_"
    assert message_type("std_srvs/srv/Trigger_Request").encode((0,)) == bytes((0, 1, 0, 0, 0))
    reply = message_type("std_srvs/srv/Trigger_Response").encode((True, "done"))
    assert reply == bytes((0, 1, 0, 0, 1, 0, 0, 0, 5, 0, 0, 0)) + b"done\0"


@pytest.mark.parametrize("values", [(1,), (1, 2, 3), (1, "a"), (1.5, 2)])
def test_other_values_than_the_definition_s_are_an_error(values: tuple) -> None:
    with pytest.raises(ValueError, match="builtin_interfaces/msg/Time: "):
        message_type("builtin_interfaces/msg/Time").encode(values)


@given(st.sampled_from([*STANDARD, POSES, "std_srvs/srv/Trigger_Response"]), st.binary(max_size=200), st.booleans())
def test_bytes_of_any_content_are_a_message_or_a_cdr_error(name: str, data: bytes, headed: bool) -> None:
    with suppress(CdrError):
        values = message_type(name).decode(bytes((0, 1, 0, 0)) + data if headed else data)
        assert isinstance(values, tuple)


def test_count_of_items_is_bounded_by_the_bytes_that_are_there() -> None:
    with pytest.raises(CdrError, match="ends too early"):
        message_type("tf2_msgs/msg/TFMessage").decode(bytes((0, 1, 0, 0)) + struct.pack("<I", 2**32 - 1))
