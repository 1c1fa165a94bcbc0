"""What drones are sent in a tick: which of them get a pose, and in which order their packets are numbered."""

import numpy as np

from formation.maths.frames import IDENTITY
from formation.messages import LabFrame
from gcs.drones.drone import Drone
from gcs.drones.packets import Packets
from tests.gcs.link import Drone as Peer
from tests.gcs.link import a_link, beat
from wire.link_messages import Address, Heartbeat, Packet, VisionPose
from wire.mavlink.codec import Codec

T0_NS = 1_000_000_000


def frame(t_ns: int, *, seen: bool = True) -> LabFrame:
    pos = np.array([[9.0, 9.0, 9.0], [1.0, 2.0, 3.0]])
    return LabFrame(0, t_ns, ("leader", "left"), pos, np.tile(IDENTITY, (2, 1)), np.array([True, seen]))


def sent(packets: Packets, now: LabFrame) -> list[Packet]:
    codec = Codec(Address(3, 1))
    return [p for d in packets.due(now, None, now.t_capture_ns) for p in codec.receive(d.data)]


def test_no_pose_is_sent_before_the_autopilot_is_known_nor_of_a_body_that_is_not_seen() -> None:
    link = a_link()
    packets = Packets([Drone(1, link)], 0, T0_NS)
    for step, known, seen, expected in (
        (0, False, True, 0),
        (1, True, True, 1),
        (2, True, False, 0),
        (3, True, True, 1),
    ):
        if known:
            Peer().say(link, beat(), T0_NS)
        t_ns = T0_NS + step * 20_000_000
        poses = [p.message for p in sent(packets, frame(t_ns, seen=seen)) if isinstance(p.message, VisionPose)]
        assert len(poses) == expected
        for pose in poses:
            assert pose.t_us == t_ns // 1000
            assert np.allclose(pose.pos_lab_m, [1.0, 2.0, 3.0])
            assert np.allclose(pose.q_lab_from_flu, IDENTITY)


def test_poses_fifty_times_a_second_numbered_as_they_are_sent() -> None:
    link = a_link()
    Peer().say(link, beat(), T0_NS)
    packets = Packets([Drone(1, link)], 0, T0_NS)
    found = [p for k in range(100) for p in sent(packets, frame(T0_NS + k * 10_000_000))]
    assert sum(isinstance(p.message, VisionPose) for p in found) == 50
    assert [p.seq for p in found] == [k % 256 for k in range(len(found))]
    assert [type(p.message) for p in found[:2]] == [VisionPose, Heartbeat]
