"""A connection whose bytes come in any pieces gives the same answers and frames; bytes from outside."""

import pytest

from mocap.sources.tcp import Session
from tests.mocap.sources import qtm_bytes, vicon_bytes
from tests.mocap.sources.qualisys.test_session import opened as qualisys
from tests.mocap.sources.recorded_feed import Kept, kept
from tests.mocap.sources.vicon.test_session import opened as vicon

SAID = {
    "qualisys": (qualisys, qtm_bytes.xml(qtm_bytes.PARAMETERS_1_19) + qtm_bytes.FRAME),
    "vicon": (vicon, vicon_bytes.FIRST + vicon_bytes.UNCHANGED),
}


def heard(kind: str, piece: int) -> tuple[bytes, list[str]]:
    open_, data = SAID[kind]
    record: Kept = kept(kind)
    session: Session = open_(record)[1]
    answers = b"".join(session.received(data[at : at + piece], 10**10) for at in range(0, len(data), piece))
    return answers, [f"{frame}" for frame in record.frames]


@pytest.mark.parametrize("kind", SAID)
@pytest.mark.parametrize("piece", [1, 7])
def test_pieces_change_nothing(kind: str, piece: int) -> None:
    answers, frames = heard(kind, len(SAID[kind][1]))
    assert frames
    assert heard(kind, piece) == (answers, frames)
