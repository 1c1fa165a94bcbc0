"""A leader's poses out of bags that `rosbags` wrote, as `ros2 bag record --storage mcap` does."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from mocap.sources.csv_file import MocapFileError, read_recording

STORE = get_typestore(Stores.ROS2_JAZZY)
POSE, ODOMETRY, TEXT = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry", "std_msgs/msg/String"
RATE_HZ, COUNT = 100.0, 20
HALF = 0.5**0.5


def header(k: int) -> Any:
    t_ns = 1_795_000_000_000_000_000 + round(k * 1e9 / RATE_HZ)
    stamp = STORE.types["builtin_interfaces/msg/Time"](sec=t_ns // 10**9, nanosec=t_ns % 10**9)
    return STORE.types["std_msgs/msg/Header"](stamp=stamp, frame_id="world")


def pose(k: int, x: float = 0.0) -> Any:
    types = STORE.types
    position = types["geometry_msgs/msg/Point"](x=x + 0.01 * k, y=2.0, z=3.0)
    orientation = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=-HALF, w=HALF)
    return types["geometry_msgs/msg/Pose"](position=position, orientation=orientation)


def message(kind: str, k: int, x: float) -> Any:
    types, none = STORE.types, np.zeros(36)
    if kind == TEXT:
        return types[TEXT](data="unrelated")
    if kind == POSE:
        return types[POSE](header=header(k), pose=pose(k, x))
    zero = types["geometry_msgs/msg/Vector3"](x=0.0, y=0.0, z=0.0)
    twist = types["geometry_msgs/msg/Twist"](linear=zero, angular=zero)
    return types[ODOMETRY](
        header=header(k), child_frame_id="base_link",
        pose=types["geometry_msgs/msg/PoseWithCovariance"](pose=pose(k, x), covariance=none),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=none),
    )  # fmt: skip


def written(
    folder: Path, topics: Mapping[str, tuple[str, float]], compression: CompressionMode = CompressionMode.NONE
) -> Path:
    """A bag of topics: the type of each, and where along x it begins."""
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {t: writer.add_connection(t, kind, typestore=STORE) for t, (kind, _) in topics.items()}
        for k in range(COUNT):
            for topic, (kind, x) in topics.items():
                data = STORE.serialize_cdr(message(kind, k, x), kind)
                writer.write(connections[topic], 1_795_000_000_100_000_000 + k * 10**7, data)
    return folder


@pytest.mark.parametrize("compression", [CompressionMode.NONE, CompressionMode.STORAGE])
@pytest.mark.parametrize("kind", [POSE, ODOMETRY])
def test_the_one_topic_with_poses_is_read_at_its_header_s_stamps(tmp_path, kind: str, compression) -> None:
    bag = written(tmp_path / "bag", {"/robot": (kind, 1.0), "/chatter": (TEXT, 0.0)}, compression)
    for path in (bag, bag / "bag.mcap"):
        recording = read_recording(path, "leader")
        assert recording.t_ns.tolist() == [k * 10**7 for k in range(COUNT)]
        np.testing.assert_allclose(recording.pos_mocap_m[:, 0], 1.0 + 0.01 * np.arange(COUNT))
        np.testing.assert_allclose(recording.q_mocap_from_marker, [[HALF, 0.0, 0.0, -HALF]] * COUNT)


def test_of_several_topics_the_body_s_own_pose_is_read(tmp_path) -> None:
    topics = {"/left/pose": (POSE, 1.0), "/leader/pose": (POSE, 2.0), "/leader/target": (POSE, 3.0)}
    assert read_recording(written(tmp_path / "bag", topics), "leader").pos_mocap_m[0, 0] == 2.0


@pytest.mark.parametrize(("topics", "why"), [
    ({"/a": (POSE, 0.0), "/b": (ODOMETRY, 0.0)}, "PoseStamped and Odometry are /a, /b; one is to name leader"),
    ({"/chatter": (TEXT, 0.0)}, "PoseStamped and Odometry are none"),
])  # fmt: skip
def test_a_bag_whose_leader_is_not_known_says_what_is_in_it(tmp_path, topics, why: str) -> None:
    bag = written(tmp_path / "bag", topics)
    with pytest.raises(MocapFileError, match=why):
        read_recording(bag, "leader")


def test_a_bag_of_another_storage_and_a_damaged_one_are_refused(tmp_path) -> None:
    (tmp_path / "sqlite").mkdir()
    with pytest.raises(MocapFileError, match="0 MCAP files in it; one is read: `ros2 bag convert`"):
        read_recording(tmp_path / "sqlite", "leader")
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(b"no bag")
    with pytest.raises(MocapFileError, match="not an MCAP file"):
        read_recording(broken, "leader")


def test_a_bag_whose_recorder_was_killed_is_read_as_far_as_it_goes(tmp_path) -> None:
    whole = (written(tmp_path / "bag", {"/robot": (POSE, 1.0)}) / "bag.mcap").read_bytes()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole[: whole.rindex(b"/robot") - 200])  # without its summary
    assert len(read_recording(cut, "leader").t_ns) == COUNT
