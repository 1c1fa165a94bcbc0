"""One body's recorded poses from a rosbag2 of MCAP: the PoseStamped or Odometry of a topic, no ROS needed."""

from collections import defaultdict
from pathlib import Path

from wire.logs.mcap_scan import LogError, read_foreign
from wire.ros2.message_types import CdrError, message_type, ros_name

POSE_AT = {"geometry_msgs/msg/PoseStamped": 3, "nav_msgs/msg/Odometry": 4}
"""Where among a message's values its pose begins: behind stamp and frame, and behind that of the child."""
Pose = tuple[float, ...]
Stamped = tuple[int, Pose]


def is_bag(path: Path) -> bool:
    """Whether a recording is a bag: its folder, or its one file."""
    return path.is_dir() or path.suffix == ".mcap"


def read_bag(path: Path, body: str) -> list[Stamped]:
    """(stamp in ns, x y z and quaternion w x y z) in the order of the stamps; LogError, OSError.

    body: of several topics the one whose path names it; `.../BODY/pose` goes before others.
    """
    file = _file_of(path)
    by_topic: dict[str, dict[int, Pose]] = defaultdict(dict)
    for topic, type_name, unix_ns, data in read_foreign(file, "cdr"):
        if type_name in POSE_AT:
            stamp_ns, pose = _pose(file, topic, type_name, data)
            by_topic[topic][stamp_ns or unix_ns] = pose
    return sorted(by_topic[_chosen(file, sorted(by_topic), ros_name(body))].items())


def _file_of(path: Path) -> Path:
    if not path.is_dir():
        return path
    files = sorted(path.glob("*.mcap"))
    if len(files) != 1:
        raise LogError(f"{path}: {len(files)} MCAP files in it; one is read: `ros2 bag convert` makes one of any bag")
    return files[0]


def _pose(file: Path, topic: str, type_name: str, data: bytes) -> Stamped:
    try:
        values = message_type(type_name).decode(data)
    except CdrError as error:
        raise LogError(f"{file}: {topic}: {error}") from error
    at = POSE_AT[type_name]
    x, y, z, qx, qy, qz, qw = values[at : at + 7]
    return values[0] * 1_000_000_000 + values[1], (x, y, z, qw, qx, qy, qz)


def _chosen(file: Path, topics: list[str], body: str) -> str:
    named = [topic for topic in topics if body in topic.split("/")]
    best = [topic for topic in named if topic.endswith(f"/{body}/pose")] or named or topics
    if len(best) == 1:
        return best[0]
    have = ", ".join(topics) or "none"
    raise LogError(
        f"{file}: topics of PoseStamped and Odometry are {have}; one is to name {body}, as /{body}/pose does"
    )
