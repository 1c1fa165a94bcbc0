import numpy as np

from formation.config import LabConfig
from formation.maths.frames import IDENTITY
from formation.messages import Datagram
from gcs.drones.autopilot_poses import AWAIT_TRUTH_NS, AutopilotPoses, streams
from wire.link_messages import (
    GROUND,
    Address,
    AttitudeQuaternion,
    Heartbeat,
    LinkMessage,
    LocalPosition,
    MavAutopilot,
    SimTruth,
    TimeSync,
)
from wire.mavlink.codec import Codec

MS = 1_000_000
HOME = (47.397742, 8.545594, 488.0)


def _lab(source: str = "mavlink") -> LabConfig:
    return LabConfig.model_validate(
        {
            "mocap": {"source": source, "rate_hz": 50.0, "delay_s": 0.01},
            "leader": {"body": "a", "sysid": 1},
            "followers": [{"body": "b", "sysid": 2, "offset_m": (0, 1, 0), "spawn_lab_m": (0.0, 1.5, 0.0)}],
        }
    )


class Lab:
    def __init__(self) -> None:
        self.poses = AutopilotPoses(_lab())
        self.codecs = {sysid: Codec(Address(sysid, 1)) for sysid in (1, 2)}
        for sysid in (1, 2):  # heard for so long that truth would have come
            self.send(sysid, Heartbeat(MavAutopilot.PX4, 2, 0, 0, 3), -AWAIT_TRUTH_NS // MS)

    def send(self, sysid: int, message: LinkMessage, ms: int):
        if isinstance(message, LocalPosition) and message.t_boot_ms < 0:
            message = message._replace(t_boot_ms=77_000 + ms)
        return self.poses.receive(Datagram(sysid, self.codecs[sysid].encode(message)), ms * MS)


def _local(x, y, z, v=(0.0, 0.0, 0.0), t_boot_ms=None) -> LocalPosition:
    """Stamped by a drone whose clock runs 77 s ahead; by default at the moment it is said."""
    return LocalPosition(-1 if t_boot_ms is None else t_boot_ms, np.array([x, y, z]), np.array(v))


def _attitude(t_boot_ms: int = 0) -> AttitudeQuaternion:
    return AttitudeQuaternion(t_boot_ms, IDENTITY, np.zeros(3))


def _truth(north_m: float, up_m: float = 0.0, v=(0.0, 0.0, 0.0), t_us: int = 0) -> SimTruth:
    lat = HOME[0] + np.degrees(north_m / 6_378_137.0)
    return SimTruth(t_us, IDENTITY, np.array(v), float(lat), HOME[1], HOME[2] + up_m)


def test_a_frame_comes_when_every_drone_has_spoken_and_each_has_its_spawn_added():
    lab = Lab()
    lab.send(1, _attitude(), 0)
    lab.send(2, _attitude(), 0)
    assert lab.send(1, _local(0.1, 0.2, 0.3), 100).seen.tolist() == [True, False]  # the other was never heard
    assert lab.send(2, _local(0.0, 0.0, 0.5), 110) is None
    frame = lab.send(1, _local(0.1, 0.2, 0.3), 120)
    assert frame.bodies == ("a", "b")
    assert frame.seen.tolist() == [True, True]
    assert np.allclose(frame.pos_lab_m, [[0.1, 0.2, 0.3], [0.0, 1.5, 0.5]], atol=1e-6)


def test_the_older_pose_is_carried_on_by_its_velocity():
    lab = Lab()
    for sysid in (1, 2):
        lab.send(sysid, _attitude(), 0)
    lab.send(2, _local(0, 0, 0), 90)
    assert lab.send(1, _local(1.0, 0.0, 0.0, (2.0, 0.0, 0.0)), 100) is None
    frame = lab.send(2, _local(0, 0, 0), 110)
    assert frame.seen.tolist() == [True, True]
    assert np.allclose(frame.pos_lab_m[0], [1.02, 0.0, 0.0])
    assert frame.t_capture_ns == 100 * MS


def test_a_drone_that_falls_silent_does_not_stop_the_frames():
    lab = Lab()
    for sysid in (1, 2):
        lab.send(sysid, _attitude(), 0)
        lab.send(sysid, _local(0, 0, 0), 0)
    frames = [frame for ms in range(20, 2000, 20) if (frame := lab.send(1, _local(0, 0, 0), ms)) is not None]
    assert len(frames) > 60
    assert not any(frame.seen[1] for frame in frames[3:])


def test_an_estimate_is_not_believed_before_truth_could_have_come():
    lab = Lab()
    lab.poses = AutopilotPoses(_lab())
    lab.send(1, _attitude(), 0)
    assert lab.send(1, _local(0.5, 0.0, 0.0), 2900) is None
    assert lab.send(1, _truth(0.0), 2950).pos_lab_m[0, 0] == 0.0
    assert lab.send(1, _local(0.5, 0.0, 0.0), 3100) is None


def test_truth_alone_is_a_pose_from_the_spawn_on_and_smoother_than_its_centimetres():
    """At 0.3 m/s north: latitude comes in steps of 11 mm, a step in two frames."""
    lab = Lab()
    seen = []
    for ms in range(0, 4000, 20):
        x = 0.3e-3 * ms
        frame = lab.send(2, _truth(x, 0.5 * x, (0.3, 0.0, 0.15), 1000 * (77_000 + ms)), ms)
        seen.append(frame.pos_lab_m[1] - [x, 1.5, 0.5 * x])
    away = np.array(seen)[50:] - np.mean(seen[50:], axis=0)
    assert np.abs(np.mean(seen[50:], axis=0)).max() < 0.006
    assert np.abs(away).max() < 0.002


def test_a_pose_that_waited_in_a_queue_is_as_old_as_its_stamp_says_and_unseen_beyond_the_limit():
    lab = Lab()
    for sysid in (1, 2):
        for ms in range(0, 1000, 100):
            lab.send(sysid, TimeSync((77_000 + ms) * MS, (ms - 2) * MS, GROUND), ms + 2)
        lab.send(sysid, _attitude(78_000), 1000)
    for stamp_ms, late_ms in ((1050, 5), (1100, 10), (1150, 60)):
        frames = [lab.send(i, _local(0, 0, 0, t_boot_ms=77_000 + stamp_ms), stamp_ms + late_ms) for i in (2, 1)]
        frame = next(frame for frame in frames if frame is not None)
        assert frame.seen[1]
        assert abs(frame.t_capture_ns - (stamp_ms - 10) * MS) < 1 * MS
    frames = [lab.send(i, _local(0, 0, 0, t_boot_ms=78_200), 1340) for i in (2, 1)]
    assert not any(frame is not None and frame.seen.any() for frame in frames)


def test_a_truth_without_a_stamp_is_as_old_as_what_else_comes_by_its_link():
    lab = Lab()
    for ms in range(0, 1000, 100):
        lab.send(1, TimeSync((77_000 + ms) * MS, (ms - 2) * MS, GROUND), ms + 2)
    lab.send(1, _attitude(78_000), 1000)
    frame = lab.send(1, _truth(0.0), 1001)
    assert frame.seen.tolist() == [True, False]
    lab.send(1, _attitude(78_100), 1150)
    frame = lab.send(1, _truth(0.0), 1150)
    assert abs(frame.t_capture_ns - 1090 * MS) < 1 * MS
    lab.send(1, _attitude(78_200), 1700)
    frame = lab.send(1, _truth(0.0), 1700)
    assert frame is None or not frame.seen.any()


def test_truths_attitude_serves_where_the_drone_reports_none():
    lab = Lab()
    turned = _truth(0.0)._replace(q_lab_from_flu=np.array([0.8, 0.0, 0.0, 0.6]))
    assert np.allclose(lab.send(1, turned, 0).q_lab_from_flu[0], turned.q_lab_from_flu, atol=1e-6)
    lab.send(1, _attitude(), 10)
    assert np.allclose(lab.send(1, turned, 20).q_lab_from_flu[0], IDENTITY)


def test_streams_are_asked_for_only_without_a_mocap():
    assert streams(_lab("zenoh")) == ()
    assert dict(streams(_lab())) == {32: 50.0, 31: 50.0, 115: 50.0, 108: 50.0}


def test_strangers_are_left_alone():
    lab = Lab()
    lab.codecs[3] = Codec(Address(3, 1))
    assert lab.send(3, _local(0, 0, 0), 0) is None
    lab.codecs[1] = Codec(Address(1, 191))
    lab.send(1, _attitude(), 0)
    assert lab.send(1, _local(0, 0, 0), 1) is None
