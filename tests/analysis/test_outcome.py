"""What counts as a landing: how fast a drone came down, where, and that it was heard to the end."""

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from analysis import report as report_page
from analysis.cli import app
from analysis.load import from_records
from analysis.outcome import outcome
from formation import topics
from formation.messages import Datagram, LabFrame, OperatorReply, OperatorRequest, Phase, PhaseChange, Verb
from gcs.drones.protocols import cut
from tests.analysis.synthetic_flight import END_S, LAB, METADATA, PHASES, T0_NS, Recipe, Record, records, t_ns, written
from wire.link_messages import DRONE_COMPONENT, GROUND, Address, Heartbeat, MavAutopilot
from wire.mavlink.codec import Codec

LEFT = 1  # among the configuration's vehicles
Move = Callable[[float, np.ndarray], None]


def moved(move: Move) -> Iterator[Record]:
    """The landing asked for at 16 s and over at 19 s; move(t_s, pos_lab_m (3, 3)) changes where the drones are."""
    for record in records(Recipe()):
        if isinstance(record.message, LabFrame):
            pos = record.message.pos_lab_m.copy()
            move((record.message.t_capture_ns - T0_NS) * 1e-9, pos)
            record = Record(record.topic, record.t_ns, replace(record.message, pos_lab_m=pos))
        yield record


def beats(left_until_s: float) -> Iterator[Record]:
    """Every drone's heartbeats, disarmed from 18.8 s on; those of `left` end at left_until_s."""
    for sysid in (1, 2, 3):
        codec = Codec(Address(sysid, DRONE_COMPONENT))
        for second in range(int(END_S)):
            t_s = second + 0.9
            if sysid != 2 or t_s < left_until_s:
                armed = 128 if 1.0 <= t_s < 18.8 else 0
                data = codec.encode(Heartbeat(MavAutopilot.PX4, 2, 1 | armed, 0, 4))
                yield Record(topics.LINK_UP, t_ns(t_s), Datagram(sysid, data))


def fall(t_s: float, pos: np.ndarray) -> None:
    """`left` drops from 2.7 m, from 17 s on."""
    if t_s > 10.0:
        pos[LEFT, 2] = max(2.7 - 4.9 * max(t_s - 17.0, 0.0) ** 2, 0.0)


def outside(t_s: float, pos: np.ndarray) -> None:
    if t_s > 16.5:
        pos[LEFT, 0] = LAB.limits.fence.high_m[0] + 0.3


def aloft(t_s: float, pos: np.ndarray) -> None:
    if t_s > 16.5:
        pos[LEFT, 2] = 0.3


@pytest.mark.parametrize(
    ("move", "told"),
    [
        (lambda t_s, pos: None, "landed"),
        (fall, "lost: left fell: it met the floor at 6.8 m/s"),
        (outside, "lost: left came down 0.30 m outside the fence"),
        (aloft, "lost: left last seen in the air at x "),
    ],
)
def test_a_landing_is_slow_in_place_and_down(move: Move, told: str):
    assert str(outcome(from_records(METADATA, moved(move)))).startswith(told)


def test_a_drone_that_fell_silent_is_lost():
    """It was last heard, armed, at 9.9 s; the landing was over at 19 s."""
    assert str(outcome(from_records(METADATA, [*records(Recipe()), *beats(left_until_s=END_S)]))) == "landed"
    told = str(outcome(from_records(METADATA, [*records(Recipe()), *beats(left_until_s=10.0)])))
    assert told.startswith("lost: left unheard for 9 s, last seen near the floor at x ")


def test_the_report_of_a_flight_that_did_not_land_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """It ended with 0, so a script that only looked at the exit code took a lost flight for a landing."""
    log = written(tmp_path / "flight.mcap", Recipe(phases=PHASES[:-2], requests=()))
    monkeypatch.setattr(report_page, "html", lambda *_: "page")
    done = CliRunner().invoke(app, ["report", str(log), "--json"])
    ended = json.loads(done.stdout)["outcome"]
    assert (done.exit_code, done.stderr) == (1, f"gcs-log: {ended}\n")


@pytest.mark.parametrize(
    ("asked", "accepted", "ended"),
    [
        (OperatorRequest(7, Verb.LAND), True, "landed"),
        (OperatorRequest(7, Verb.LAND, "left"), True, "aborted: body right unseen"),
        (OperatorRequest(7, Verb.LAND), False, "aborted: body right unseen"),
    ],
)
def test_a_landing_is_asked_for_by_a_request_of_all_that_was_not_rejected(
    asked: OperatorRequest, accepted: bool, ended: str
) -> None:
    phases = tuple((t_s, phase, "body right unseen" if phase is Phase.LAND else cause) for t_s, phase, cause in PHASES)
    more = (asked, OperatorReply(7, accepted, ""))
    entries = [
        Record(topic, t_ns(15.5), message) for topic, message in zip((topics.REQUEST, topics.REPLY), more, strict=True)
    ]
    flown = [*records(Recipe(phases=phases, requests=())), *entries]
    assert str(outcome(from_records(METADATA, sorted(flown, key=lambda each: each.t_ns)))) == ended


@pytest.mark.parametrize(("at_s", "ended"), [(12.0, "cut: left: motors cut at 0.30 m"), (18.99, "landed")])
def test_motors_cut_in_the_air_are_no_landing_and_on_the_floor_are(at_s: float, ended: str):
    data = Codec(GROUND).encode(cut(Address(2, DRONE_COMPONENT)))
    stop = Record(topics.LINK_DOWN, t_ns(at_s), Datagram(2, data))
    assert str(outcome(from_records(METADATA, [*records(Recipe()), stop]))) == ended


def test_a_landing_asked_for_on_the_floor_is_no_flight():
    """Armed, disarmed by its time-out, then told to land: nobody ever left the floor."""

    def stays(record: Record) -> Record | None:
        flown = (Phase.TAKEOFF, Phase.FORMATION, Phase.HOLD)
        if isinstance(record.message, PhaseChange) and record.message.phase in flown:
            return None
        if isinstance(record.message, LabFrame):
            pos = record.message.pos_lab_m.copy()
            pos[:, 2] = 0.0
            return Record(record.topic, record.t_ns, replace(record.message, pos_lab_m=pos))
        return record

    kept = [r for r in map(stays, records(Recipe())) if r is not None]
    assert str(outcome(from_records(METADATA, kept))) == "aborted: never took off"
