from struct import pack

import numpy as np
import pytest

from formation.messages import Severity
from formation.mocap_config import MocapConfig, NatNetConfig
from mocap.sources.natnet import messages
from mocap.sources.natnet import session as session_module
from mocap.sources.natnet.messages import MessageId
from mocap.sources.natnet.session import NatNetSession
from sim.cameras.servers.natnet import NatNetSettings
from tests.mocap.sources import natnet_packets as outside
from tests.mocap.sources.natnet_lockstep import CLIENT, MS, SERVER, FeedRecorder, Lockstep

VERSIONS = [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]


def greeted(recorder: FeedRecorder, names: dict[str, str] | None = None) -> NatNetSession:
    """A session that the server has answered."""
    mocap = MocapConfig(source="natnet", natnet=NatNetConfig(host=SERVER), names=names or {})
    assert mocap.natnet is not None
    session = NatNetSession(mocap.natnet, 8 * MS, ("drone",), recorder.feed(mocap))
    session.start(recorder.now_ns)
    assert [messages.unpack(data)[0] for data in session.due(recorder.now_ns)] == [MessageId.CONNECT]
    session.received(outside.SERVER_INFO, SERVER, recorder.now_ns)
    return session


def kinds(session: NatNetSession, now_ns: int) -> list[int]:
    return [messages.unpack(data)[0] for data in session.due(now_ns)]


def test_a_whole_conversation_gives_its_frame():
    recorder = FeedRecorder()
    session = greeted(recorder, {"Quad": "drone"})
    assert MessageId.REQUEST_MODELS in kinds(session, recorder.now_ns)
    session.received(outside.MODELS, SERVER, recorder.now_ns)
    session.received(outside.FRAME, SERVER, recorder.now_ns)
    ((_, frame),) = recorder.frames
    assert (frame.seq, frame.bodies, frame.seen.tolist()) == (outside.NUMBER_SMALL, ("drone",), [True])
    np.testing.assert_allclose(frame.pos_mocap_m, [[0.25, 1.5, -0.75]], rtol=1e-6)
    np.testing.assert_allclose(frame.q_mocap_from_marker, [[-0.8, 0.0, 0.6, 0.0]], rtol=1e-6)
    assert recorder.texts == ["connected to Motive 2.1, NatNet 3.0 at 10.0.0.1", "rigid bodies: drone"]
    assert session.status().bodies == ("drone",)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("multicast", ["", "239.255.42.99"])
def test_every_version_over_both_ways(version, multicast):
    link = Lockstep(multicast, NatNetSettings(version=version))
    link.seen = (True, False)
    link.run(1.0)
    assert len(link.recorder.frames) > 90
    frame = link.recorder.frames[-1][1]
    assert (frame.bodies, frame.seen.tolist()) == (("lead", "left"), [True, False])
    np.testing.assert_array_equal(frame.pos_mocap_m, [[0, 1, 2], [3, 4, 5]])
    assert link.session.status().lost == 0
    assert link.recorder.refusals.count == 0


def test_nothing_but_harmless_requests_is_ever_sent():
    """A request that names a version, or a time-line command, would move what Motive plays."""
    link = Lockstep()
    link.run(3.0)
    link.bodies = ("lead", "third")
    link.run(3.0)
    unpacked = [messages.unpack(data) for data in link.asked]
    allowed = {MessageId.CONNECT, MessageId.REQUEST_MODELS, MessageId.ECHO_REQUEST, MessageId.KEEP_ALIVE}
    assert {kind for kind, _ in unpacked} == allowed | {MessageId.REQUEST}
    assert {payload for kind, payload in unpacked if kind == MessageId.REQUEST} == {b"Bitstream\0"}


def test_echoes_are_asked_for_at_20_hz_for_two_seconds_then_at_10_hz():
    recorder = FeedRecorder()
    session = greeted(recorder)
    sent = []
    for k in range(200):
        now_ns = recorder.now_ns + k * 25 * MS
        session.received(outside.FRAME, SERVER, now_ns)
        sent += [k * 0.025] * kinds(session, now_ns).count(MessageId.ECHO_REQUEST)
    assert sum(t < 2.0 for t in sent) == 40
    assert sum(t >= 2.0 for t in sent) == 30


def test_bodies_renamed_and_added_are_followed():
    link = Lockstep(wanted=("lead", "right"))
    link.run(0.5)
    assert "body right not in the server's list, which is: lead, left" in link.recorder.texts
    link.bodies = ("lead", "right")
    link.run(0.3)
    assert link.recorder.frames[-1][1].bodies == ("lead", "right")
    assert link.recorder.texts[-1] == "rigid bodies: lead, right"
    link.bodies, link.seen = ("lead", "right", "third"), (True, True, True)
    link.run(0.3)
    assert link.recorder.frames[-1][1].bodies == ("lead", "right", "third")


def test_a_change_told_in_a_frame_that_was_lost_is_followed_all_the_same():
    link = Lockstep()
    link.run(0.5)
    link.bodies, link.frames_lost = ("lead", "other"), True
    link.responder.show(link.bodies)
    link.responder.changed = False
    link.run(0.02)
    link.frames_lost = False
    link.run(0.3)
    assert link.recorder.frames[-1][1].bodies == ("lead", "other")
    assert link.session.status().lost == 2


def test_frames_that_the_numbers_lack_are_lost_and_a_repetition_is_none():
    link = Lockstep()
    link.run(0.5)
    link.frames_lost = True
    link.run(0.05)
    link.frames_lost = False
    link.run(0.1)
    assert link.session.status().lost == 5
    before = len(link.recorder.frames)
    packet = link.responder.frame(link.recorder.frames[-1][1], link.recorder.now_ns)
    link.session.received(packet, SERVER, link.recorder.now_ns)
    assert len(link.recorder.frames) == before
    assert link.session.status().lost == 5


def test_a_server_that_is_killed_is_reported_once_and_back_within_a_second_of_its_return():
    link = Lockstep()
    link.run(1.0)
    died, link.responder = link.responder, None
    link.run(5.0)
    assert not link.session.status().connected
    assert link.recorder.texts[2:] == ["no answer from 10.0.0.1:1510 for 2 s; trying again"]
    frames = len(link.recorder.frames)
    link.responder = died
    died.clients.clear()
    died.ids = {"left": 1, "lead": 2}
    died.clock_step_ns = -3_000_000 * MS
    link.bodies = ("left", "lead")
    link.run(1.0)
    assert len(link.recorder.frames) - frames > 40
    assert {frame.bodies for _, frame in link.recorder.frames[frames:]} == {("left", "lead")}
    errors = link.errors_ns(link.recorder.now_ns - 300 * MS)
    assert max(map(abs, errors)) < 1 * MS


def test_a_server_restarted_at_once_with_other_ids_swaps_no_names():
    """Too short to be silent: the numbers begin anew, and nothing is believed until the new list has come."""
    link = Lockstep("239.255.42.99")
    link.run(1.0)
    link.responder.ids = {"left": 1, "lead": 2}
    link.bodies = ("left", "lead")
    link.seq = 0
    frames = len(link.recorder.frames)
    link.run(1.0)
    after = [frame for _, frame in link.recorder.frames[frames:]]
    assert len(after) > 50
    assert {frame.bodies for frame in after} == {("left", "lead")}


def test_a_server_that_never_answers_and_one_that_sends_no_frames_are_distinguished():
    link = Lockstep("239.255.42.99")
    link.frames_lost = True
    answering, link.responder = link.responder, None
    link.run(3.0)
    assert link.recorder.texts == ["no answer from 10.0.0.1:1510 for 2 s; trying again"]
    link.responder = answering
    link.run(3.0)
    assert link.recorder.texts[-1] == (
        "Motive 3.1, NatNet 4.1 answers, but sends no frames: is streaming on, "
        "and is `interface` our address in the cameras' network?"
    )
    link.frames_lost = False
    link.run(1.0)
    assert link.recorder.events[-1].severity is Severity.INFO
    assert len(link.recorder.frames) > 50


def test_a_server_that_streams_by_another_transmission_is_reported():
    link = Lockstep()
    link.responder.group = "239.255.42.99"
    link.frames_lost = True
    link.run(3.0)
    assert link.recorder.texts[-1].endswith("it streams multicast to 239.255.42.99, the lab file says unicast")


def test_the_version_of_the_stream_is_asked_for_and_counts():
    """SERVERINFO says what Motive can, the answer what it streams."""
    recorder = FeedRecorder()
    session = greeted(recorder, {"lead": "drone"})
    session.received(outside.whole_models((3, 0)), SERVER, recorder.now_ns)
    session.received(outside.packet(3, b"Bitstream,4.1.0\0"), SERVER, recorder.now_ns)
    session.received(outside.whole_models((4, 1)), SERVER, recorder.now_ns)
    session.received(outside.whole_frame((4, 1)), SERVER, recorder.now_ns)
    assert [frame.bodies for _, frame in recorder.frames] == [("drone", "Körper 2")]
    session.received(outside.packet(3, b"Bitstream,5.0.0\0"), SERVER, recorder.now_ns)
    session.received(outside.whole_frame((4, 1)), SERVER, recorder.now_ns)
    assert len(recorder.frames) == 1
    assert "NatNet 5.0, which is not known" in recorder.texts[-1]
    assert recorder.refusals.count == 1


def test_a_wrong_version_that_reads_the_frames_but_not_the_list_is_put_right():
    """4.0 and 3.0 differ in descriptions alone; a server of 3.0 does not answer which version it streams."""
    link = Lockstep(settings=NatNetSettings(version=(3, 0)))
    link.run(1.0)
    wrong = Lockstep(settings=NatNetSettings(version=(4, 0))).responder
    (info,) = wrong.received(outside.packet(0, b""), CLIENT, link.recorder.now_ns)
    link.session.received(info, SERVER, link.recorder.now_ns)
    frames = len(link.recorder.frames)
    link.run(2.0)
    assert len(link.recorder.frames) - frames > 100
    assert link.session.status().server == "Motive 2.1, NatNet 3.0"


def test_packets_of_other_senders_are_rejected_and_counted():
    recorder = FeedRecorder()
    session = greeted(recorder)
    session.received(outside.MODELS, SERVER, recorder.now_ns)
    session.received(outside.FRAME, SERVER, recorder.now_ns)
    for data in (outside.MODELS, outside.ECHO_RESPONSE, outside.FRAME, outside.SERVER_INFO, b"\7\0\1\0"):
        session.received(data, "10.0.0.66", recorder.now_ns)
    session.received(outside.ECHO_RESPONSE, SERVER, recorder.now_ns)
    assert recorder.refusals.count == 6
    assert len(recorder.frames) == 1


def test_frames_of_another_address_are_taken_where_the_server_itself_sends_none():
    """A server with two network cards answers from one and streams from the other."""
    recorder = FeedRecorder()
    session = greeted(recorder)
    session.received(outside.MODELS, SERVER, recorder.now_ns)
    session.received(outside.FRAME, "10.0.0.7", recorder.now_ns)
    assert len(recorder.frames) == 1
    assert recorder.refusals.count == 0


def test_two_bodies_of_one_frame_and_one_that_is_not_listed():
    recorder = FeedRecorder()
    session = greeted(recorder)
    one = outside.packet(5, pack("<ii", 1, 1) + b"lead\0" + pack("<ii3fi", 7, -1, 0, 0, 0, 0))
    session.received(one, SERVER, recorder.now_ns)
    recorder.now_ns += 1000 * MS
    session.received(outside.whole_frame((3, 0)), SERVER, recorder.now_ns)
    assert recorder.frames[-1][1].bodies == ("lead",)
    assert MessageId.REQUEST_MODELS in kinds(session, recorder.now_ns)


def test_numbers_that_are_no_poses_are_handed_on_to_be_judged():
    recorder = FeedRecorder()
    session = greeted(recorder)
    session.received(outside.MODELS, SERVER, recorder.now_ns)
    at = outside.FRAME.index(pack("<i7f", outside.BODY[0], *outside.BODY[1], *outside.BODY[2])) + 4
    session.received(outside.FRAME[:at] + pack("<f", np.nan) + outside.FRAME[at + 4 :], SERVER, recorder.now_ns)
    assert np.isnan(recorder.frames[-1][1].pos_mocap_m[0, 0])


def test_keep_alives_are_sent_to_a_unicast_server_only():
    for multicast, alive in (("", True), ("239.255.42.99", False)):
        link = Lockstep(multicast)
        link.run(12.0)
        assert (CLIENT in link.responder.clients) is alive
        assert len(link.recorder.frames) > 1100


def test_bodies_of_one_streaming_id_are_named_and_the_others_fly_on(monkeypatch):
    recorder = FeedRecorder()
    session = greeted(recorder, {"lead": "drone"})
    session.received(outside.packet(3, b"Bitstream,4.1.0\0"), SERVER, recorder.now_ns)
    monkeypatch.setattr(session_module, "rigid_bodies", lambda *_: [(7, "lead"), (9, "a"), (9, "b")])
    session.received(outside.whole_models((4, 1)), SERVER, recorder.now_ns)
    session.received(outside.whole_frame((4, 1)), SERVER, recorder.now_ns)
    assert "rigid bodies a and b have one streaming id (9): they are left out" in recorder.texts[-2]
    assert [frame.bodies for _, frame in recorder.frames] == [("drone",)]
