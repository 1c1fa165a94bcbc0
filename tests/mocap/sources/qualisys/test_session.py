"""A connection to QTM, bytes by hand from its documentation; time by hand."""

import struct

import numpy as np
import pytest

from formation.mocap_config import QualisysConfig
from mocap.sources.qualisys import Qualisys, QualisysSession, command
from mocap.sources.tcp import ProtocolError
from tests.mocap.sources.qtm_bytes import (
    FRAME,
    NO_MORE_DATA,
    NO_PARAMETERS,
    PARAMETERS_1_19,
    PARAMETERS_1_25,
    SETTINGS_CHANGED,
    SHUTTING_DOWN,
    VERSION_SET,
    WELCOME,
    xml,
)
from tests.mocap.sources.recorded_feed import Kept, kept

S_NS, MS_NS = 1_000_000_000, 1_000_000
ASK, STREAM = command("GetParameters 6D"), command("StreamFrames AllFrames 6D")


def opened(record: Kept) -> tuple[Qualisys, QualisysSession]:
    source = Qualisys(QualisysConfig(), ("Body1",), 8 * MS_NS, record.feed())
    session, hello = source.open(0, "", "")
    assert hello == b""
    assert session.received(WELCOME, 0) == command("Version 1.19")
    assert session.received(VERSION_SET, 0) == ASK
    return source, session


def streaming(record: Kept) -> tuple[Qualisys, QualisysSession]:
    source, session = opened(record)
    assert session.received(xml(PARAMETERS_1_19), 0) == STREAM
    return source, session


def frame(number: int, stamp_us: int) -> bytes:
    return FRAME[:8] + struct.pack("<qI", stamp_us, number) + FRAME[20:]


def test_a_frame_has_names_millimetres_and_a_time():
    record = kept("qualisys")
    source, session = streaming(record)
    assert session.received(FRAME, 10 * S_NS) == b""
    (raw,) = record.frames
    assert raw.bodies == ("Body1", "Body & 2")
    assert raw.seen.tolist() == [True, False]
    np.testing.assert_allclose(raw.pos_mocap_m[0], [1.00025, -0.2505, 1.5], atol=1e-9)
    np.testing.assert_allclose(raw.q_mocap_from_marker[0], [np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)], atol=1e-9)
    assert np.isfinite(raw.pos_mocap_m).all()
    assert raw.t_capture_ns == 10 * S_NS - 8 * MS_NS
    assert record.texts() == ["the server names Body1, Body & 2"]
    status = source.status()
    assert status.bodies == raw.bodies
    assert not status.latency_measured
    assert status.latency_s == pytest.approx(0.008)


def test_gaps_in_the_numbers_are_lost_frames():
    record = kept("qualisys")
    source, session = streaming(record)
    for number in (100, 105, 110, 125):  # every fifth of the cameras' frames is sent
        session.received(frame(number, number * 1000), 10 * S_NS + number * MS_NS)
    assert [raw.seq for raw in record.frames] == [0, 1, 2, 5]
    assert source.status().lost == 2
    session.received(frame(125, 126_000), 10 * S_NS + 126 * MS_NS)
    assert record.refused() == ["refused: 1 x a frame whose number came already"]


def test_after_a_change_of_settings_no_frame_goes_by_an_old_name():
    record = kept("qualisys")
    _, session = streaming(record)
    session.received(FRAME, S_NS)
    assert session.received(SETTINGS_CHANGED, S_NS) == ASK
    session.received(frame(70_001, 5_000_010_000), S_NS + 10 * MS_NS)
    assert len(record.frames) == 1
    assert session.received(xml(PARAMETERS_1_25), S_NS + 15 * MS_NS) == b""  # it streams already
    session.received(frame(70_002, 5_000_020_000), S_NS + 20 * MS_NS)
    assert record.frames[-1].bodies == ("refined", "Table")
    assert record.texts()[-1] == "the server does not name Body1; it names refined, Table"
    assert record.refused() == ["refused: 1 x a frame while the bodies' names are asked for"]


def test_a_frame_of_another_number_of_bodies_has_them_named_first():
    record = kept("qualisys")
    _, session = opened(record)
    one = "<QTM><The_6D><Body><Name>Body1</Name></Body></The_6D></QTM>"
    session.received(xml(one), 0)
    assert session.received(FRAME, 10 * S_NS) == ASK
    assert session.received(frame(70_001, 1), 10 * S_NS + 10 * MS_NS) == b""  # once, not at each frame
    assert record.frames == []
    session.received(xml(PARAMETERS_1_19), 10 * S_NS + 20 * MS_NS)
    session.received(frame(70_002, 2), 10 * S_NS + 20 * MS_NS)
    assert len(record.frames) == 1


def test_a_qtm_without_bodies_or_measurement_says_so_and_is_kept():
    record = kept("qualisys")
    _, session = opened(record)
    assert session.received(NO_PARAMETERS, 0) == STREAM
    session.received(NO_MORE_DATA + NO_MORE_DATA, 0)
    assert record.texts() == [
        "the server does not name Body1; it names nothing",
        "QTM measures nothing: start a measurement or its real-time preview",
    ]
    assert session.due(S_NS) == ASK
    session.received(xml(PARAMETERS_1_19), S_NS)
    session.received(FRAME, S_NS)
    assert len(record.frames) == 1


def test_bad_packets_are_counted_and_the_next_is_read():
    record = kept("qualisys")
    _, session = streaming(record)
    session.received(FRAME[:28] + b"\xff\xff\xff\x7f" + FRAME[32:], S_NS)  # the component's bodies, or its size
    session.received(xml("<a>"), S_NS)
    session.received(struct.pack("<II", 24, 3) + struct.pack("<qII", 1, 1, 0), S_NS)
    session.received(FRAME, S_NS)
    assert len(record.frames) == 1
    (refused,) = record.refused()
    assert "6D parameters: not XML" in refused
    assert "data packet: no 6D component" in refused
    assert record.refusals.count == 3


@pytest.mark.parametrize(
    ("words", "why"),
    [(b"Version NOT supported", "update QTM"), (b"Connection refused. Max number of clients reached.", "many clients")],
)
def test_a_qtm_that_does_not_answer_or_will_not_serve_is_left(words, why):
    session, _ = Qualisys(QualisysConfig(), (), 0, kept("qualisys").feed()).open(0, "", "")
    assert session.due(2 * S_NS) == b""
    with pytest.raises(ProtocolError, match="no answer to the version"):
        session.due(2 * S_NS + 1)
    with pytest.raises(ProtocolError, match=why):
        session.received(struct.pack("<II", 9 + len(words), 0) + words + b"\0", 0)


def test_unexpected_answers_are_reported_a_few_times_at_most():
    record = kept("qualisys")
    _, session = streaming(record)
    for k in range(50):
        words = f"trouble {k // 2}\x1b[2J".encode()
        session.received(struct.pack("<II", 9 + len(words), 0) + words + b"\0", S_NS)
    session.received(SHUTTING_DOWN, S_NS)
    assert [text for text in record.texts() if "trouble" in text] == [f"QTM says: trouble {k}[2J" for k in range(8)]
    assert record.texts()[-1] == "QTM is shutting down"


def test_a_body_that_is_off_in_qtm_is_named_and_the_others_fly_on():
    record = kept("qualisys")
    _, session = opened(record)
    off = "<Body><Name>wand</Name><Enabled>false</Enabled></Body><Body>"
    session.received(xml(PARAMETERS_1_19.replace("<Body>", off, 1)), 0)
    session.received(FRAME, 10 * S_NS)
    session.received(xml(PARAMETERS_1_19.replace("<Body>", off, 1)), 11 * S_NS)
    assert record.frames[-1].bodies == ("Body1", "Body & 2")
    assert record.texts()[-1] == "not enabled in QTM, and not in its frames: wand"
    assert len(record.texts()) == 3
