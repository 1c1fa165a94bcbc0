from struct import pack

import natnet_packets as outside
import numpy as np
import pytest
from natnet_lockstep import CLIENT, MS, SERVER, Lockstep, Told

from formation.messages import Severity
from formation.mocap_config import MocapConfig, NatNetConfig
from gcs.mocap.sources.natnet import messages
from gcs.mocap.sources.natnet.messages import MessageId
from gcs.mocap.sources.natnet.session import NatNetSession
from sim.cameras.servers.natnet import NatNetSettings

VERSIONS = [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2)]


def greeted(told: Told, names: dict[str, str] | None = None) -> NatNetSession:
    """A session that the server has answered."""
    mocap = MocapConfig(source="natnet", natnet=NatNetConfig(host=SERVER), names=names or {})
    assert mocap.natnet is not None
    session = NatNetSession(mocap.natnet, 8 * MS, ("drone",), told.feed(mocap))
    session.start(told.now_ns)
    assert [messages.unpack(data)[0] for data in session.due(told.now_ns)] == [MessageId.CONNECT]
    session.received(outside.SERVER_INFO, SERVER, told.now_ns)
    return session


def kinds(session: NatNetSession, now_ns: int) -> list[int]:
    return [messages.unpack(data)[0] for data in session.due(now_ns)]


def test_a_whole_conversation_gives_its_frame():
    told = Told()
    session = greeted(told, {"Quad": "drone"})
    assert MessageId.REQUEST_MODELS in kinds(session, told.now_ns)
    session.received(outside.MODELS, SERVER, told.now_ns)
    session.received(outside.FRAME, SERVER, told.now_ns)
    ((_, frame),) = told.frames
    assert (frame.seq, frame.bodies, frame.seen.tolist()) == (outside.NUMBER_SMALL, ("drone",), [True])
    np.testing.assert_allclose(frame.pos_mocap_m, [[0.25, 1.5, -0.75]], rtol=1e-6)
    np.testing.assert_allclose(frame.q_mocap_from_marker, [[-0.8, 0.0, 0.6, 0.0]], rtol=1e-6)
    assert told.texts == ["connected to Motive 2.1, NatNet 3.0 at 10.0.0.1", "rigid bodies: drone"]
    assert session.status().bodies == ("drone",)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("multicast", ["", "239.255.42.99"])
def test_every_version_over_both_ways(version, multicast):
    link = Lockstep(multicast, NatNetSettings(version=version))
    link.seen = (True, False)
    link.run(1.0)
    assert len(link.told.frames) > 90
    frame = link.told.frames[-1][1]
    assert (frame.bodies, frame.seen.tolist()) == (("lead", "left"), [True, False])
    np.testing.assert_array_equal(frame.pos_mocap_m, [[0, 1, 2], [3, 4, 5]])
    assert link.session.status().lost == 0
    assert link.told.refusals.count == 0


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
    told = Told()
    session = greeted(told)
    sent = []
    for k in range(200):
        now_ns = told.now_ns + k * 25 * MS
        session.received(outside.FRAME, SERVER, now_ns)
        sent += [k * 0.025] * kinds(session, now_ns).count(MessageId.ECHO_REQUEST)
    assert sum(t < 2.0 for t in sent) == 40
    assert sum(t >= 2.0 for t in sent) == 30


def test_bodies_renamed_and_added_are_followed():
    link = Lockstep(wanted=("lead", "right"))
    link.run(0.5)
    assert "body right not in the server's list, which is: lead, left" in link.told.texts
    link.bodies = ("lead", "right")
    link.run(0.3)
    assert link.told.frames[-1][1].bodies == ("lead", "right")
    assert link.told.texts[-1] == "rigid bodies: lead, right"
    link.bodies, link.seen = ("lead", "right", "third"), (True, True, True)
    link.run(0.3)
    assert link.told.frames[-1][1].bodies == ("lead", "right", "third")


def test_a_change_told_in_a_frame_that_was_lost_is_followed_all_the_same():
    link = Lockstep()
    link.run(0.5)
    link.bodies, link.frames_lost = ("lead", "other"), True
    link.responder.show(link.bodies)
    link.responder.changed = False
    link.run(0.02)
    link.frames_lost = False
    link.run(0.3)
    assert link.told.frames[-1][1].bodies == ("lead", "other")
    assert link.session.status().lost == 2


def test_frames_that_the_numbers_lack_are_lost_and_a_repetition_is_none():
    link = Lockstep()
    link.run(0.5)
    link.frames_lost = True
    link.run(0.05)
    link.frames_lost = False
    link.run(0.1)
    assert link.session.status().lost == 5
    before = len(link.told.frames)
    packet = link.responder.frame(link.told.frames[-1][1], link.told.now_ns)
    link.session.received(packet, SERVER, link.told.now_ns)
    assert len(link.told.frames) == before
    assert link.session.status().lost == 5


def test_a_server_that_is_killed_is_told_of_once_and_back_within_a_second_of_its_return():
    link = Lockstep()
    link.run(1.0)
    died, link.responder = link.responder, None
    link.run(5.0)
    assert not link.session.status().connected
    assert link.told.texts[2:] == ["no answer from 10.0.0.1:1510 for 2 s; trying again"]
    frames = len(link.told.frames)
    link.responder = died
    died.clients.clear()
    died.ids = {"left": 1, "lead": 2}
    died.clock_step_ns = -3_000_000 * MS
    link.bodies = ("left", "lead")
    link.run(1.0)
    assert len(link.told.frames) - frames > 40
    assert {frame.bodies for _, frame in link.told.frames[frames:]} == {("left", "lead")}
    errors = link.errors_ns(link.told.now_ns - 300 * MS)
    assert max(map(abs, errors)) < 1 * MS


def test_a_server_restarted_at_once_with_other_ids_swaps_no_names():
    """Too short to be silent: the numbers begin anew, and nothing is believed until the new list has come."""
    link = Lockstep("239.255.42.99")
    link.run(1.0)
    link.responder.ids = {"left": 1, "lead": 2}
    link.bodies = ("left", "lead")
    link.seq = 0
    frames = len(link.told.frames)
    link.run(1.0)
    after = [frame for _, frame in link.told.frames[frames:]]
    assert len(after) > 50
    assert {frame.bodies for frame in after} == {("left", "lead")}


def test_a_server_that_never_answers_and_one_that_sends_no_frames_are_told_apart():
    link = Lockstep("239.255.42.99")
    link.frames_lost = True
    answering, link.responder = link.responder, None
    link.run(3.0)
    assert link.told.texts == ["no answer from 10.0.0.1:1510 for 2 s; trying again"]
    link.responder = answering
    link.run(3.0)
    assert link.told.texts[-1] == (
        "Motive 3.1, NatNet 4.1 answers, but sends no frames: is streaming on, "
        "and is `interface` our address in the cameras' network?"
    )
    link.frames_lost = False
    link.run(1.0)
    assert link.told.events[-1].severity is Severity.INFO
    assert len(link.told.frames) > 50


def test_a_server_that_streams_the_other_way_is_told_of():
    link = Lockstep()
    link.responder.group = "239.255.42.99"
    link.frames_lost = True
    link.run(3.0)
    assert link.told.texts[-1].endswith("it streams multicast to 239.255.42.99, the lab file says unicast")


def test_the_version_of_the_stream_is_asked_for_and_counts():
    """SERVERINFO says what Motive can, the answer what it streams."""
    told = Told()
    session = greeted(told, {"lead": "drone"})
    session.received(outside.whole_models((3, 0)), SERVER, told.now_ns)
    session.received(outside.packet(3, b"Bitstream,4.1.0\0"), SERVER, told.now_ns)
    session.received(outside.whole_models((4, 1)), SERVER, told.now_ns)
    session.received(outside.whole_frame((4, 1)), SERVER, told.now_ns)
    assert [frame.bodies for _, frame in told.frames] == [("drone", "Körper 2")]
    session.received(outside.packet(3, b"Bitstream,5.0.0\0"), SERVER, told.now_ns)
    session.received(outside.whole_frame((4, 1)), SERVER, told.now_ns)
    assert len(told.frames) == 1
    assert "NatNet 5.0, which is not known" in told.texts[-1]
    assert told.refusals.count == 1


def test_a_wrong_version_that_reads_the_frames_but_not_the_list_is_put_right():
    """4.0 and 3.0 differ in descriptions alone; a server of 3.0 does not answer which version it streams."""
    link = Lockstep(settings=NatNetSettings(version=(3, 0)))
    link.run(1.0)
    wrong = Lockstep(settings=NatNetSettings(version=(4, 0))).responder
    (info,) = wrong.received(outside.packet(0, b""), CLIENT, link.told.now_ns)
    link.session.received(info, SERVER, link.told.now_ns)
    frames = len(link.told.frames)
    link.run(2.0)
    assert len(link.told.frames) - frames > 100
    assert link.session.status().server == "Motive 2.1, NatNet 3.0"


def test_what_strangers_send_is_refused_and_counted():
    told = Told()
    session = greeted(told)
    session.received(outside.MODELS, SERVER, told.now_ns)
    session.received(outside.FRAME, SERVER, told.now_ns)
    for data in (outside.MODELS, outside.ECHO_RESPONSE, outside.FRAME, outside.SERVER_INFO, b"\7\0\1\0"):
        session.received(data, "10.0.0.66", told.now_ns)
    session.received(outside.ECHO_RESPONSE, SERVER, told.now_ns)
    assert told.refusals.count == 6
    assert len(told.frames) == 1


def test_frames_of_another_address_are_taken_where_the_server_itself_sends_none():
    """A server with two network cards answers from one and streams from the other."""
    told = Told()
    session = greeted(told)
    session.received(outside.MODELS, SERVER, told.now_ns)
    session.received(outside.FRAME, "10.0.0.7", told.now_ns)
    assert len(told.frames) == 1
    assert told.refusals.count == 0


def test_two_bodies_of_one_frame_and_one_that_is_not_listed():
    told = Told()
    session = greeted(told)
    one = outside.packet(5, pack("<ii", 1, 1) + b"lead\0" + pack("<ii3fi", 7, -1, 0, 0, 0, 0))
    session.received(one, SERVER, told.now_ns)
    told.now_ns += 1000 * MS
    session.received(outside.whole_frame((3, 0)), SERVER, told.now_ns)
    assert told.frames[-1][1].bodies == ("lead",)
    assert MessageId.REQUEST_MODELS in kinds(session, told.now_ns)


def test_numbers_that_are_no_poses_are_handed_on_to_be_judged():
    told = Told()
    session = greeted(told)
    session.received(outside.MODELS, SERVER, told.now_ns)
    at = outside.FRAME.index(pack("<i7f", outside.BODY[0], *outside.BODY[1], *outside.BODY[2])) + 4
    session.received(outside.FRAME[:at] + pack("<f", np.nan) + outside.FRAME[at + 4 :], SERVER, told.now_ns)
    assert np.isnan(told.frames[-1][1].pos_mocap_m[0, 0])


def test_keep_alives_are_sent_to_a_unicast_server_only():
    for multicast, alive in (("", True), ("239.255.42.99", False)):
        link = Lockstep(multicast)
        link.run(12.0)
        assert (CLIENT in link.responder.clients) is alive
        assert len(link.told.frames) > 1100
