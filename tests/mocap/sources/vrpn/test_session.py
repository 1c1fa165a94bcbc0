"""One connection: the VRPN library's bytes in, frames and answers out."""

import struct

import numpy as np
import pytest

from mocap.sources.tcp import ProtocolError
from mocap.sources.vrpn import messages
from mocap.sources.vrpn.messages import Stream
from mocap.sources.vrpn.session import VrpnSession
from tests.mocap.sources.vrpn import bytes as vrpn_bytes
from tests.mocap.sources.vrpn.rig import Rig, lab_of

MS, SECOND = 1_000_000, 1_000_000_000
T0 = 5_000 * SECOND
PERIOD_NS = 10 * MS
STAMP_NS = 1_795_348_379_813_306_000


def pose(sender: int, stamp_ns: int, pos: tuple[float, ...], sensor: int = 0) -> bytes:
    """A turn by 90 degrees about z, as VRPN writes it: x y z w."""
    half = 0.5**0.5
    payload = struct.pack(">ii7d", sensor, sensor, *pos, 0.0, 0.0, half, half)
    seconds, ns = divmod(stamp_ns, SECOND)
    return struct.pack(">IIIiiI", 88, seconds, ns // 1000, sender, 4, 0) + payload


def named(*names: str) -> bytes:
    """Senders from 1 on."""
    return b"".join(messages.description(-1, k, name.encode()) for k, name in enumerate(names, 1))


def begun(rig: Rig, *names: str) -> VrpnSession:
    session = rig.session(T0)
    session.received(vrpn_bytes.COOKIE + named(*names) + vrpn_bytes.POSE_IS_4, T0)
    return session


def exposed(session: VrpnSession, k: int, data: bytes) -> None:
    """Exposure k arrives, and so much later is surely out."""
    session.received(data, T0 + k * PERIOD_NS)
    session.frames.deliver(T0 + k * PERIOD_NS + 2 * MS)


def test_the_librarys_server_is_understood():
    rig = Rig(lab_of("vrpn"))
    session = rig.session(T0)
    answer = session.received(vrpn_bytes.SERVER_SAYS, T0)
    answered = [(m.sender, m.type, messages.described(m.payload)) for m in Stream().messages(answer)]
    assert answered == [(0, -2, b"vrpn_Base ping_message"), (0, -1, b"VRPN Control"), (1, -1, b"leader")]
    sent = vrpn_bytes.POSE_OF_LEADER + vrpn_bytes.VELOCITY_OF_LEADER + vrpn_bytes.SENSOR_1_OF_LEADER
    assert session.received(sent, T0) == b""
    assert rig.frames == []
    assert session.frames.due_ns == T0 + 2 * MS
    session.frames.deliver(T0 + 2 * MS)
    (frame,) = rig.frames
    assert frame.bodies == ("leader", "leader:1")
    assert frame.q_mocap_from_marker.tolist() == [[1.0, 0.0, 0.0, 0.0]] * 2
    assert frame.seen.tolist() == [True, True]
    assert rig.refusals.count == 0


def test_a_session_is_the_same_in_any_pieces_and_units_are_the_labs():
    data = vrpn_bytes.COOKIE + named("leader", "left") + vrpn_bytes.POSE_IS_4
    for k in range(5):
        data += pose(1, STAMP_NS + k * PERIOD_NS, (k, 0.0, 0.0)) + pose(2, STAMP_NS + k * PERIOD_NS, (k, 1.0, 0.0))
    frames = []
    for piece in (len(data), 1, 13):
        rig = Rig(lab_of("vrpn", unit="mm"))
        session = rig.session(T0)
        for at in range(0, len(data), piece):
            session.received(data[at : at + piece], T0)
        session.frames.deliver(T0 + SECOND)
        frames.append([(f.seq, f.bodies, f.pos_mocap_m.tolist(), f.seen.tolist()) for f in rig.frames])
    assert frames[0][-1][2] == [[0.004, 0.0, 0.0], [0.004, 0.001, 0.0]]
    assert rig.frames[0].q_mocap_from_marker[0].tolist() == [0.5**0.5, 0.0, 0.0, 0.5**0.5]
    assert frames[1][-1] == frames[2][-1] == frames[0][-1]
    assert len(frames[0]) == len(frames[1]) == len(frames[2]) == 5


def test_a_hidden_body_is_unseen_and_keeps_its_place():
    rig = Rig(lab_of("vrpn"))
    session = begun(rig, "leader", "left")
    for k in range(4):
        data = pose(1, STAMP_NS + k * PERIOD_NS, (k, 0.0, 0.0))
        exposed(session, k, data if k == 2 else data + pose(2, STAMP_NS + k * PERIOD_NS, (k, 1.0, 0.0)))
    assert [frame.seen.tolist() for frame in rig.frames] == [[True, True]] * 2 + [[True, False], [True, True]]
    assert rig.frames[2].pos_mocap_m.tolist() == [[2.0, 0.0, 0.0], [1.0, 1.0, 0.0]]
    assert [frame.seq for frame in rig.frames] == [0, 1, 2, 3]


def test_a_chingmu_device_sends_bodies_as_sensors_twice_and_in_millimetres():
    rig = Rig(lab_of("chingmu"))
    session = begun(rig, "Skeletons", "MCServer")
    for k in range(5):
        stamp_ns = STAMP_NS + k * PERIOD_NS
        data = pose(1, stamp_ns, (9.0, 9.0, 9.0), 300)
        for sensor in (300, 301, 302, 307):
            data += 2 * pose(2, stamp_ns, (1000.0 * k, 0.0, sensor), sensor)
        exposed(session, k, data)
    assert len(rig.frames) == 5
    assert rig.frames[-1].bodies == ("leader", "left", "right", "307")
    assert rig.frames[-1].pos_mocap_m[:, 0].tolist() == pytest.approx([4.0] * 4)
    assert rig.frames[-1].pos_mocap_m[:, 2].tolist() == pytest.approx([0.300, 0.301, 0.302, 0.307])
    assert rig.refusals.count == 0


def test_a_lost_chingmu_body_repeats_and_is_unseen():
    rig = Rig(lab_of("chingmu"))
    session = begun(rig, "MCServer")
    noise = np.random.default_rng(3).normal(0.0, 0.1, (60, 2, 3))
    noise[40:50, 1] = noise[39, 1]
    for k in range(60):
        both = (pose(1, STAMP_NS + k * PERIOD_NS, tuple(noise[k, i]), 300 + i) for i in range(2))
        exposed(session, k, b"".join(2 * one for one in both))
    assert len(rig.frames) == 60
    assert [f.seen.tolist() for f in rig.frames] == [[True, not 40 <= k < 50] for k in range(60)]


@pytest.mark.parametrize(
    ("names", "expected"),
    [
        ({"302": "leader"}, ["left", "right", "leader", "303"]),
        ({"303": "leader", "300": "right"}, ["right", "left", "302", "leader"]),
    ],
)
def test_sensors_are_the_bodies_that_the_file_says(names: dict[str, str], expected: list[str]):
    rig = Rig(lab_of("chingmu", names=names))
    session = begun(rig, "MCServer")
    exposed(session, 0, b"".join(pose(1, STAMP_NS, (1.0, 2.0, 3.0), sensor) for sensor in range(300, 304)))
    assert list(rig.frames[0].bodies) == expected


def test_bodies_come_and_change_their_names_at_any_time():
    rig = Rig(lab_of("vrpn"))
    session = begun(rig, "leader", "left")
    for k in range(30):
        data = pose(1, STAMP_NS + k * PERIOD_NS, (k, 0.0, 0.0)) + pose(2, STAMP_NS + k * PERIOD_NS, (k, 1.0, 0.0))
        if k == 10:
            data = messages.description(-1, 3, b"right") + data
        if k == 20:
            data = messages.description(-1, 2, b"wand") + data
        data += pose(3, STAMP_NS + k * PERIOD_NS, (k, 2.0, 0.0)) if k >= 10 else b""
        exposed(session, k, data)
    assert [frame.bodies for frame in rig.frames[::10]] == [
        ("leader", "left"),
        ("leader", "left", "right"),
        ("leader", "wand", "right"),
    ]
    assert [frame.seq for frame in rig.frames] == list(range(30))
    assert all(frame.seen.all() for frame in rig.frames)


def test_missing_bodies_devices_and_sensors_are_reported_once_and_when_they_came():
    rig = Rig(lab_of("vrpn"))
    session = begun(rig, "leader", "wand")
    exposed(session, 0, pose(1, STAMP_NS, (1.0, 2.0, 3.0), 1))
    for k in range(30):
        session.due(T0 + k * 100 * MS)
    assert sum("no tracker left, right; it has leader, wand" in text for text in rig.texts()) == 1
    session.received(messages.description(-1, 3, b"left") + messages.description(-1, 4, b"right"), T0 + 3 * SECOND)
    session.due(T0 + 4 * SECOND)
    assert "poses come of leader:1, not of sensor 0" in rig.texts()[-1]
    rig = Rig(lab_of("chingmu"))
    session = begun(rig, "MCAvatar")
    session.due(T0 + SECOND)
    assert rig.texts() == ["the server has no device MCServer; it has MCAvatar"]
    rig = Rig(lab_of("chingmu", {"device": "MCAvatar"}))
    session = begun(rig, "MCAvatar")
    exposed(session, 0, pose(1, STAMP_NS, (1.0, 2.0, 3.0), 300))
    session.due(T0 + SECOND)
    assert rig.texts() == ["no poses of sensor 301 (left), 302 (right); those of 300 come"]


def test_the_server_is_asked_whether_it_lives():
    """As the library's own client asks: no payload, the sender and the type by the asker's numbers."""
    session = begun(Rig(lab_of("vrpn")), "leader")
    assert session.due(T0 + 100 * MS) == b""
    asked = list(Stream().messages(session.due(T0 + 500 * MS)))
    (library,) = Stream().messages(vrpn_bytes.CLIENT_PINGS_LEADER)
    assert [(m.sender, m.payload) for m in asked] == [(library.sender, library.payload)]
    assert asked[0].type == 0
    assert session.due(T0 + 900 * MS) == b""
    assert session.due(T0 + SECOND) != b""


def test_capture_times_are_on_our_clock_whatever_the_servers_shows():
    """Two hours off, and set by an hour while it runs: 5 s later the stamps are believed again, to 2 ms."""
    rng = np.random.default_rng(2)
    rig = Rig(lab_of("vrpn", latency_s=0.005))
    session = begun(rig, "leader")
    for k in range(2000):
        server_ns = STAMP_NS + 7_200 * SECOND + (3_600 * SECOND if k >= 1000 else 0)
        exposure_ns = k * PERIOD_NS
        delay_ns = 5 * MS + int(rng.exponential(1 * MS))
        data = pose(1, server_ns + exposure_ns, (k, 0.0, 0.0))
        session.received(data, T0 + exposure_ns + delay_ns)
        session.frames.deliver(T0 + exposure_ns + delay_ns + 2 * MS)
    assert len(rig.frames) == 2000
    off_ns = np.array([f.t_capture_ns - T0 - k * PERIOD_NS for k, f in enumerate(rig.frames)])
    assert np.abs(off_ns[200:1000]).max() < MS
    assert np.abs(off_ns[1500:]).max() < 2 * MS
    assert session.frames.latency_ns is not None
    assert session.frames.latency_ns >= 4 * MS


def test_poses_without_stamps_are_taken_as_they_come():
    rig = Rig(lab_of("vrpn"))
    session = begun(rig, "leader", "left")
    for k in range(50):
        exposed(session, k, pose(1, 0, (k, 0.0, 0.0)) + pose(2, 0, (k, 1.0, 0.0)))
    assert len(rig.frames) == 50
    assert all(frame.seen.all() for frame in rig.frames)
    assert {b.t_capture_ns - a.t_capture_ns for a, b in zip(rig.frames, rig.frames[1:], strict=False)} == {PERIOD_NS}


def test_datagrams_bring_poses_and_cannot_end_the_connection():
    rig = Rig(lab_of("vrpn", {"udp": True}))
    session = begun(rig, "leader", "left")
    whole = pose(1, STAMP_NS, (1.0, 0.0, 0.0)), pose(2, STAMP_NS, (2.0, 0.0, 0.0))
    stranger = messages.description(-1, 1, b"stranger")
    session.datagrams((*whole, b"\xff" * 40, pose(1, STAMP_NS + PERIOD_NS, (1.0, 0.0, 0.0))[:-8], stranger), T0)
    session.frames.deliver(T0 + SECOND)
    assert [frame.bodies for frame in rig.frames] == [("leader", "left")]
    assert " ".join(rig.refused()) == (
        "refused: 1 x datagram: a message's length cannot be right, 1 x datagram that ends within a message"
    )


def test_an_impossible_message_is_rejected_and_nothing_else_is_lost():
    rig = Rig(lab_of("vrpn"))
    session = begun(rig, "leader")
    short = messages.message(STAMP_NS, 1, 4, bytes(60))
    stranger = pose(77, STAMP_NS, (1.0, 2.0, 3.0))
    no_number = pose(1, STAMP_NS, (float("nan"), 1e308, -1.0))
    exposed(session, 0, short + stranger + no_number)
    assert len(rig.frames) == 1
    text = " ".join(rig.refused())
    assert "1 x pose message of another length than 64 bytes" in text
    assert "1 x pose of a sender that has no name yet" in text


def test_a_signalling_nan_is_a_number_as_any():
    """Arithmetic with it raises a flag, which numpy warns of."""
    rig = Rig(lab_of("chingmu"))
    session = begun(rig, "MCServer")
    signalling = bytes.fromhex("7ff0009300000000")
    for k in range(3):
        sent = pose(1, STAMP_NS + k * PERIOD_NS, (k, 2.0, 3.0), 300)
        exposed(session, k, sent[:32] + signalling + sent[40:])
    assert [np.isnan(frame.pos_mocap_m[0]).tolist() for frame in rig.frames] == [[True, False, False]] * 3


def test_no_more_bodies_are_remembered_than_any_lab_has():
    rig = Rig(lab_of("vrpn"))
    session = begun(rig, "leader")
    exposed(session, 0, b"".join(pose(1, STAMP_NS, (1.0, 2.0, 3.0), sensor) for sensor in range(300)))
    assert len(rig.frames[0].bodies) == 256
    assert "44 x pose of more than 256 senders and sensors" in " ".join(rig.refused())


@pytest.mark.parametrize(
    "data",
    [
        vrpn_bytes.COOKIE + messages.description(-1, -5, b"leader"),
        vrpn_bytes.COOKIE + messages.description(-2, 2000, b"vrpn_Tracker Pos_Quat"),
    ],
)
def test_a_number_that_cannot_be_right_ends_the_connection(data: bytes):
    with pytest.raises(ProtocolError):
        Rig(lab_of("vrpn")).session(T0).received(data, T0)


def test_a_tracker_whose_clock_is_an_hour_off_is_named_and_its_body_seen_with_the_others():
    rig = Rig(lab_of("vrpn"))
    session = begun(rig, "leader", "right", "left")
    for k in range(120):
        stamp_ns = STAMP_NS + k * PERIOD_NS
        data = pose(1, stamp_ns + 3600 * SECOND, (k, 0.0, 0.0))
        exposed(session, k, data + pose(2, stamp_ns, (k, 1.0, 0.0)) + pose(3, stamp_ns, (k, 2.0, 0.0)))
    session.due(T0 + 2 * SECOND)
    session.due(T0 + 3 * SECOND)
    assert all(frame.seen.all() for frame in rig.frames[-100:])
    texts = [event.text for event in rig.events if "clock" in event.text]
    assert texts == ["leader: its tracker's clock is +3600 s from the others', which is corrected; set it"]


@pytest.mark.parametrize(("step_ns", "said"), [(SECOND // 64, "16 ms"), (SECOND, "1000 ms")])
def test_stamps_that_step_coarsely_are_named_and_arrivals_used(step_ns, said):
    rig = Rig(lab_of("vrpn"))
    session = begun(rig, "leader", "left")
    for k in range(200):
        stamp_ns = (STAMP_NS + k * PERIOD_NS) // step_ns * step_ns
        exposed(session, k, pose(1, stamp_ns, (k, 0.0, 0.0)) + pose(2, stamp_ns, (k, 1.0, 0.0)))
    (text,) = [event.text for event in rig.events if "step by" in event.text]
    assert f"step by {said}, poses come more often" in text
    steps_ns = np.diff([frame.t_capture_ns for frame in rig.frames[-100:]])
    assert (steps_ns == PERIOD_NS).all()
