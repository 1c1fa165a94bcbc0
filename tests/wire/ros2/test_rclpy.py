"""CDR against a real rclpy, where there is one: ROS 2 itself, or the wheels `ros-rclpy` and `ros-geometry-msgs`."""

import pytest

from wire.ros2.message_types import message_type

serialization = pytest.importorskip("rclpy.serialization")
geometry_msgs = pytest.importorskip("geometry_msgs.msg")


@pytest.mark.parametrize("frame_id", ["", "lab", "a frame of ä longer name"])
def test_pose_is_what_rclpy_serializes_and_reads(frame_id: str) -> None:
    kind, values = message_type("geometry_msgs/msg/PoseStamped"), (12, 345, frame_id, 1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8)
    message = geometry_msgs.PoseStamped()
    message.header.stamp.sec, message.header.stamp.nanosec, message.header.frame_id = values[:3]
    position, q = message.pose.position, message.pose.orientation
    position.x, position.y, position.z, q.x, q.y, q.z, q.w = values[3:]
    data = kind.encode(values)
    assert serialization.serialize_message(message) == data
    assert serialization.deserialize_message(data, geometry_msgs.PoseStamped) == message
