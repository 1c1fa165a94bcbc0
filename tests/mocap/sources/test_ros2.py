"""Messages of a ROS 2 graph into frames; the time is the test's, and the graph is in tests/sim/cameras/servers."""

import numpy as np
import pytest

from formation.config import LabConfig
from mocap.sources.ros2 import Ros2Source, _topics
from tests.mocap.sources.recorded_feed import Kept
from wire.ros2.message_types import message_type

MS, SECOND = 1_000_000, 1_000_000_000
STAMP_NS = 1_795_348_379_813_306_000
HALF = 0.5**0.5
TURN = (0.0, 0.0, HALF, HALF)
"""x y z w of a quarter turn to the left."""
POSE, ODOMETRY = "geometry_msgs/msg/PoseStamped", "nav_msgs/msg/Odometry"
ARRAY = "motion_capture_tracking_interfaces/msg/NamedPoseArray"


class Rig(Kept):
    """A source between a lab of three bodies and lists."""

    def __init__(self, **mocap) -> None:
        self.lab = LabConfig.model_validate(
            {
                "leader": {"body": "leader"},
                "followers": [
                    {"body": body, "sysid": sysid, "offset_m": (-1.0, 1.0 * sysid, 0.0)}
                    for sysid, body in enumerate(("left", "right"), 2)
                ],
                "mocap": {"source": "ros2", **mocap},
            }
        )
        super().__init__(self.lab.mocap)
        self.source = Ros2Source(self.lab, self.feed())

    def hear(self, body: str, type_name: str, values: tuple) -> None:
        kind = message_type(type_name)
        self.source.receive(body, kind.dds_name, kind.encode(values), self.now_ns)

    def expire(self) -> None:
        self.now_ns += 5 * MS
        self.source._frames.deliver(self.now_ns)


def stamp(k: int = 0) -> tuple[int, int]:
    return divmod(STAMP_NS + 10 * k * MS, SECOND)


def test_poses_of_one_stamp_are_one_frame_that_is_out_with_its_last_pose() -> None:
    rig = Rig()
    for k in range(3):
        rig.now_ns += 10 * MS
        for n, body in enumerate(("leader", "left", "right")):
            rig.hear(body, POSE, (*stamp(k), "world", 1.0 * n, 2.0, 0.01 * k, *TURN))
        if k == 0:
            rig.expire()
    assert [frame.seq for frame in rig.frames] == [0, 1, 2]
    for k, frame in enumerate(rig.frames):
        assert frame.bodies == ("leader", "left", "right")
        np.testing.assert_allclose(frame.pos_mocap_m, [(n, 2.0, 0.01 * k) for n in range(3)])
        np.testing.assert_allclose(frame.q_mocap_from_marker, [(HALF, 0.0, 0.0, HALF)] * 3)
        assert frame.seen.all()
    captures = np.array([frame.t_capture_ns for frame in rig.frames])
    assert np.diff(captures).tolist() == [10 * MS] * 2


def test_header_stamp_is_the_capture_time_whatever_the_publisher_s_clock_shows() -> None:
    """Of messages that are late by up to 3 ms, by the quickest, and the configured constant."""
    rig = Rig(latency_s=0.004)
    start_ns = rig.now_ns
    for k in range(200):
        rig.now_ns = start_ns + 10 * k * MS + (k % 4) * MS
        rig.hear("leader", POSE, (*stamp(k), "world", 0.01 * k, 0.0, 1.0, *TURN))
        rig.expire()
    exposed = np.array([frame.t_capture_ns - start_ns for frame in rig.frames])
    np.testing.assert_allclose(exposed[10:], 10 * MS * np.arange(10, 200) - 4 * MS, atol=10_000)


def test_odometry_s_pose_is_read_and_an_array_s_by_its_names() -> None:
    rig = Rig(names={"cf7": "left"})
    covariance = (0.0,) * 36
    rig.hear(
        "leader", ODOMETRY, (*stamp(), "odom", "base", 7.0, 8.0, 9.0, *TURN, *covariance, *(0.0,) * 6, *covariance)
    )
    rig.expire()
    rig.hear("", ARRAY, (*stamp(1), "world", (("cf7", 1.0, 2.0, 3.0, *TURN), ("wand", 4.0, 5.0, 6.0, *TURN))))
    rig.expire()
    in_v2 = (*stamp(2), "world", 5, (("camera", 4000), ("network", 900)), (("cf7", 1.5, 2.0, 3.0, *TURN),))
    rig.hear("", f"{ARRAY}V2", in_v2)
    rig.expire()
    first, second, third = rig.frames
    assert third.pos_mocap_m[third.bodies.index("left")].tolist() == [1.5, 2.0, 3.0]
    assert (first.bodies, first.pos_mocap_m.tolist()) == (("leader",), [[7.0, 8.0, 9.0]])
    assert second.bodies == ("leader", "left", "wand")
    assert second.seen.tolist() == [False, True, True]
    assert second.pos_mocap_m[1:].tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


@pytest.mark.parametrize(("dds_name", "data", "why"), [
    ("std_msgs::msg::dds_::String_", b"\0\1\0\0", "of a type that holds no poses"),
    (message_type(POSE).dds_name, b"\0\1\0\0\1", "none of its type"),
    (message_type(ARRAY).dds_name, b"", "none of its type"),
])  # fmt: skip
def test_what_is_no_pose_is_rejected_and_counted(dds_name: str, data: bytes, why: str) -> None:
    rig = Rig()
    rig.source.receive("left", dds_name, data, rig.now_ns)
    assert rig.frames == []
    assert why in rig.refused()[0]


def test_topics_are_a_body_s_own_or_one_of_all_and_the_leader_may_have_another() -> None:
    each = Rig(names={"cf-7": "left"})
    assert _topics(each.lab, each.source._config) == {
        "/vrpn_mocap/leader/pose": "leader", "/vrpn_mocap/cf_7/pose": "cf-7", "/vrpn_mocap/right/pose": "right",
    }  # fmt: skip
    tracked = Rig(ros2={"topic": "/poses", "leader": "/turtle/odom"})
    assert _topics(tracked.lab, tracked.source._config) == {"/poses": "", "/turtle/odom": "leader"}


@pytest.mark.parametrize("topic", ["poses", "/a//b", "/a/*", "/{name}/pose", "/a/"])
def test_a_topic_that_is_none_is_refused(topic: str) -> None:
    with pytest.raises(ValueError, match="ros2"):
        Rig(ros2={"topic": topic})


def test_any_number_of_strangers_keeps_no_body_of_the_lab_out() -> None:
    rig = Rig()
    strangers = tuple((f"wand{k}", float(k), 0.0, 0.0, *TURN) for k in range(300))
    rig.hear("", ARRAY, (*stamp(), "world", strangers))
    rig.expire()
    rig.hear("", ARRAY, (*stamp(1), "world", (("left", 1.0, 2.0, 3.0, *TURN),)))
    rig.expire()
    assert "pose of more than 256 bodies" in rig.refused()[0]
    last = rig.frames[-1]
    assert last.pos_mocap_m[last.seen].tolist() == [[1.0, 2.0, 3.0]]
    assert "left" in last.bodies
