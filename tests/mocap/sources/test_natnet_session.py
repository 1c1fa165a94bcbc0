from struct import pack

import numpy as np
import pytest

from formation.messages import Severity
from mocap.sources.natnet import packets
from mocap.sources.natnet import session as session_module
from mocap.sources.natnet.packets import MessageId
from mocap.sources.natnet.session import NatNetSession
from sim.cameras.servers.natnet import NatNetSettings
from tests.mocap.sources import natnet_packets as outside
from tests.mocap.sources.natnet_lockstep import CLIENT, MS, SERVER, Lockstep
from tests.mocap.sources.recorded_feed import Kept, kept


def greeted(names: dict[str, str] | None = None) -> tuple[Kept, NatNetSession]:
    """A session that the server has answered."""
    recorder = kept("natnet", natnet={"host": SERVER}, names=names or {})
    session = NatNetSession(recorder.config.natnet, 8 * MS, ("drone",), recorder.feed())
    session.start(recorder.now_ns)
    assert [packets.unpack(data)[0] for data in session.due(recorder.now_ns)] == [MessageId.CONNECT]
    session.received(outside.SERVER_INFO, SERVER, recorder.now_ns)
    return recorder, session


def kinds(session: NatNetSession, now_ns: int) -> list[int]:
    return [packets.unpack(data)[0] for data in session.due(now_ns)]


def test_a_whole_conversation_gives_its_frame():
    recorder, session = greeted({"lead": "drone"})
    assert MessageId.REQUEST_MODELS in kinds(session, recorder.now_ns)
    session.received(outside.MODELS, SERVER, recorder.now_ns)
    session.received(outside.FRAME, SERVER, recorder.now_ns)
    (frame,) = recorder.frames
    assert (frame.seq, frame.bodies, frame.seen.tolist()) == (outside.NUMBER, ("drone", "Körper 2"), [True, False])
    np.testing.assert_allclose(frame.pos_mocap_m[0], [1.5, -2.0, 0.25])
    np.testing.assert_allclose(frame.q_mocap_from_marker[0], [0.8, 0.0, 0.6, 0.0], rtol=1e-6)
    assert recorder.texts()[0] == "connected to Motive 2.1, NatNet 3.0 at 10.0.0.1"
    assert "drone" in recorder.texts()[1]


@pytest.mark.parametrize("version", [(3, 0), (4, 0), (4, 2)])
@pytest.mark.parametrize("multicast", ["", "239.255.42.99"])
def test_every_version_over_both_ways_by_harmless_requests_alone(version, multicast):
    """A request that names a version, or a time-line command, would move what Motive plays."""
    link = Lockstep(multicast, NatNetSettings(version=version))
    link.seen = (True, False)
    link.run(1.0)
    unpacked = [packets.unpack(data) for data in link.asked]
    requests = (MessageId.CONNECT, MessageId.REQUEST_MODELS, MessageId.ECHO_REQUEST, MessageId.KEEP_ALIVE)
    assert {kind for kind, _ in unpacked} - {MessageId.REQUEST} <= set(requests)
    assert {payload for kind, payload in unpacked if kind == MessageId.REQUEST} <= {b"Bitstream\0"}
    assert len(link.recorder.frames) > 90
    frame = link.recorder.frames[-1]
    assert (frame.bodies, frame.seen.tolist()) == (("lead", "left"), [True, False])
    np.testing.assert_array_equal(frame.pos_mocap_m, [[0, 1, 2], [3, 4, 5]])
    assert link.session.status().lost == 0
    assert link.recorder.refusals.count == 0


def test_echoes_are_asked_for_at_20_hz_for_two_seconds_then_at_10_hz():
    recorder, session = greeted()
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
    assert "body right not in the server's list, which is: lead, left" in link.recorder.texts()
    link.bodies = ("lead", "right")
    link.run(0.3)
    assert link.recorder.frames[-1].bodies == ("lead", "right")
    assert link.recorder.texts()[-1] == "rigid bodies: lead, right"
    link.bodies, link.seen = ("lead", "right", "third"), (True, True, True)
    link.run(0.3)
    assert link.recorder.frames[-1].bodies == ("lead", "right", "third")


def test_a_server_that_is_killed_is_reported_once_and_back_within_a_second_of_its_return():
    link = Lockstep()
    link.run(1.0)
    died, link.responder = link.responder, None
    link.run(5.0)
    assert not link.session.status().connected
    assert link.recorder.texts()[2:] == ["no answer from 10.0.0.1:1510 for 2 s; trying again"]
    frames = len(link.recorder.frames)
    link.responder = died
    died.clients.clear()
    died.ids = {"left": 1, "lead": 2}
    died.clock_step_ns = -3_000_000 * MS
    link.bodies = ("left", "lead")
    link.run(1.0)
    assert len(link.recorder.frames) - frames > 40
    assert {frame.bodies for frame in link.recorder.frames[frames:]} == {("left", "lead")}
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
    after = link.recorder.frames[frames:]
    assert len(after) > 50
    assert {frame.bodies for frame in after} == {("left", "lead")}


def test_a_server_that_never_answers_and_one_that_sends_no_frames_are_distinguished():
    link = Lockstep("239.255.42.99")
    link.frames_lost = True
    answering, link.responder = link.responder, None
    link.run(3.0)
    assert link.recorder.texts() == ["no answer from 10.0.0.1:1510 for 2 s; trying again"]
    link.responder = answering
    link.run(3.0)
    assert link.recorder.texts()[-1] == (
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
    assert link.recorder.texts()[-1].endswith("it streams multicast to 239.255.42.99, the lab file says unicast")


def test_the_version_of_the_stream_is_asked_for_and_counts():
    """SERVERINFO says what Motive can, the answer what it streams."""
    recorder, session = greeted({"lead": "drone"})
    session.received(outside.whole_models((3, 0)), SERVER, recorder.now_ns)
    session.received(outside.packet(3, b"Bitstream,4.1.0\0"), SERVER, recorder.now_ns)
    session.received(outside.whole_models((4, 1)), SERVER, recorder.now_ns)
    session.received(outside.whole_frame((4, 1)), SERVER, recorder.now_ns)
    assert [frame.bodies for frame in recorder.frames] == [("drone", "Körper 2")]
    session.received(outside.packet(3, b"Bitstream,5.0.0\0"), SERVER, recorder.now_ns)
    session.received(outside.whole_frame((4, 1)), SERVER, recorder.now_ns)
    assert len(recorder.frames) == 1
    assert "NatNet 5.0, which is not known" in recorder.texts()[-1]
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
    recorder, session = greeted()
    session.received(outside.MODELS, SERVER, recorder.now_ns)
    session.received(outside.FRAME, SERVER, recorder.now_ns)
    for data in (outside.MODELS, outside.ECHO_RESPONSE, outside.FRAME, outside.SERVER_INFO, b"\7\0\1\0"):
        session.received(data, "10.0.0.66", recorder.now_ns)
    session.received(outside.ECHO_RESPONSE, SERVER, recorder.now_ns)
    assert recorder.refusals.count == 6
    assert len(recorder.frames) == 1


def test_frames_of_another_address_are_taken_where_the_server_itself_sends_none():
    """A server with two network cards answers from one and streams from the other."""
    recorder, session = greeted()
    session.received(outside.MODELS, SERVER, recorder.now_ns)
    session.received(outside.FRAME, "10.0.0.7", recorder.now_ns)
    assert len(recorder.frames) == 1
    assert recorder.refusals.count == 0


def test_two_bodies_of_one_frame_and_one_that_is_not_listed():
    recorder, session = greeted()
    one = outside.packet(5, pack("<ii", 1, 1) + b"lead\0" + pack("<ii3fi", 7, -1, 0, 0, 0, 0))
    session.received(one, SERVER, recorder.now_ns)
    recorder.now_ns += 1000 * MS
    session.received(outside.whole_frame((3, 0)), SERVER, recorder.now_ns)
    assert recorder.frames[-1].bodies == ("lead",)
    assert MessageId.REQUEST_MODELS in kinds(session, recorder.now_ns)


def test_keep_alives_are_sent_to_a_unicast_server_only():
    link = Lockstep()
    link.run(12.0)
    assert CLIENT in link.responder.clients
    assert len(link.recorder.frames) > 1100
    link = Lockstep("239.255.42.99")
    link.run(3.0)
    assert MessageId.KEEP_ALIVE not in {packets.unpack(data)[0] for data in link.asked}


def test_bodies_of_one_streaming_id_are_named_and_the_others_fly_on(monkeypatch):
    recorder, session = greeted({"lead": "drone"})
    session.received(outside.packet(3, b"Bitstream,4.1.0\0"), SERVER, recorder.now_ns)
    monkeypatch.setattr(session_module, "rigid_bodies", lambda *_: [(7, "lead"), (9, "a"), (9, "b")])
    session.received(outside.whole_models((4, 1)), SERVER, recorder.now_ns)
    session.received(outside.whole_frame((4, 1)), SERVER, recorder.now_ns)
    assert "rigid bodies a and b have one streaming id (9): they are left out" in recorder.texts()[-2]
    assert [frame.bodies for frame in recorder.frames] == [("drone",)]


def jittery(seed: int):
    """0.2 ms and an exponential jitter of 5 ms in the mean, each packet its own."""
    rng = np.random.default_rng(seed)
    return lambda: 0.0002 + rng.exponential(0.005)


def test_capture_time_is_within_1_ms_under_jitter_and_bursts():
    """The server's clock has the frequency of a recorded session, and was started later than ours."""
    link = Lockstep(settings=NatNetSettings(version=(3, 0), clock_hz=3_312_787, clock_s=-999.0), delay=jittery(3))
    link.burst = 10
    link.run(1.0)
    since_ns = link.recorder.now_ns
    link.run(10.0)
    errors = np.abs(link.errors_ns(since_ns))
    assert len(errors) > 980
    assert np.percentile(errors, 99) < 1 * MS
    status = link.session.status()
    assert status.latency_measured
    assert 0.0 < status.uncertainty_s < 0.002


def test_cameras_that_report_no_exposure_give_arrival_less_the_latency():
    link = Lockstep(settings=NatNetSettings(stamps=False), delay=jittery(6))
    link.run(3.0)
    came = list(zip(link.recorder.came_ns, link.recorder.frames, strict=True))
    assert came
    assert all(now_ns - frame.t_capture_ns == 8 * MS for now_ns, frame in came)
    assert not link.session.status().latency_measured


def test_a_clock_that_was_set_by_an_hour_is_followed_by_the_next_echo():
    link = Lockstep(delay=jittery(4))
    link.run(2.0)
    link.responder.clock_step_ns = 3600 * 10**9
    link.run(0.2)
    assert "the server's clock was set" in link.recorder.texts()
    link.run(4.8)
    since_ns = link.recorder.now_ns
    link.run(2.0)
    assert np.percentile(np.abs(link.errors_ns(since_ns)), 99) < 2 * MS
