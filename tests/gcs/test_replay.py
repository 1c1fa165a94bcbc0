from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from formation import topics
from formation.messages import Phase, Verb
from gcs.recording import Recorder, run_metadata
from gcs.replay import ReplayError, first_difference, replay
from tests.gcs.fakes import T0_NS, FakeLab, triangle
from wire.logs.mcap_read import Entry, Stored, read_log
from wire.logs.mcap_write import LogWriter
from wire.schema import schema_of

CONFIG = triangle(
    leader={
        "body": "lead",
        "sysid": 1,
        "trajectories": {"eight": {"kind": "figure8", "length_m": 0.8, "period_s": 3.0}},
    }
)


class RecordedCore:
    """A core that a host records, as daemon and lockstep do."""

    def __init__(self, core, record) -> None:
        self._core, self._record = core, Recorder(record)
        self.next_deadline_ns, self.state = core.next_deadline_ns, core.state

    @property
    def phase(self) -> Phase:
        return self._core.phase

    def receive(self, message, now_ns):
        self._record.input(message, now_ns)
        self._core.receive(message, now_ns)

    def tick(self, now_ns):
        outgoing = self._core.tick(now_ns)
        self._record.tick(outgoing, now_ns)
        return outgoing


@dataclass(frozen=True)
class MemoryLog:
    """A log that was never written."""

    metadata: dict[str, str]
    entries: list[Entry]
    left_out: dict[str, frozenset[str]] = field(default_factory=dict)

    def only(self, *wanted):
        for entry in self.entries:
            if entry.topic in wanted:
                schema = schema_of(entry.topic.type)
                yield Stored(entry.topic, entry.t_ns, schema.encode(entry.message), schema.own)


def _flown(record) -> FakeLab:
    """By a trajectory that is chosen: the configured one holds."""
    lab = FakeLab(CONFIG)
    lab.core = RecordedCore(lab.core, record)
    lab.run(1.0)
    assert lab.reply(lab.ask(Verb.TRAJECTORY, "eight")).accepted
    lab.fly()
    lab.run(2.5)
    assert abs(lab.drones[1].pos[1]) > 0.02
    return lab


@pytest.fixture(scope="module")
def log() -> MemoryLog:
    entries: list[Entry] = []
    _flown(lambda topic, message, t_ns: entries.append(Entry(topic, t_ns, message)))
    return MemoryLog(run_metadata(CONFIG, T0_NS), entries)


def test_a_log_of_before_the_codes_replays_by_what_it_holds(log):
    entries = [
        e if e.topic is not topics.EVENT else replace(e, message=replace(e.message, code="")) for e in log.entries
    ]
    assert any(e.topic is topics.EVENT for e in entries)
    assert not replay(MemoryLog(log.metadata, entries)).identical
    assert replay(MemoryLog(log.metadata, entries, {"event": frozenset({"code"})})).identical


def _changed(log: MemoryLog, index: int, message) -> MemoryLog:
    entries = list(log.entries)
    entries[index] = replace(entries[index], message=message)
    return replace(log, entries=entries)


def _nth(log: MemoryLog, topic, n: int) -> int:
    return [i for i, entry in enumerate(log.entries) if entry.topic is topic][n]


def test_a_flight_replays_bit_by_bit_from_its_file(tmp_path: Path):
    path = tmp_path / "flight.mcap"
    with LogWriter(path, run_metadata(CONFIG, T0_NS), threaded=False) as writer:
        lab = _flown(writer.write)
    result = replay(read_log(path))
    assert result.identical, str(result.difference)
    assert result.ticks == len(lab.ticks)
    assert result.agreed > 4 * lab.seq


def test_a_log_cut_off_in_the_middle_of_a_tick_replays_as_far_as_it_goes(log):
    cut = replace(log, entries=log.entries[: _nth(log, topics.COMMAND, 200)])
    assert replay(cut).identical


def test_one_changed_bit_of_an_output_is_named(log):
    index = _nth(log, topics.TARGET, 300)
    entry = log.entries[index]
    thrust = entry.message.thrust_norm.astype(np.float32).astype(np.float64)  # as a log holds it
    recorded = thrust[1]
    thrust[1] = np.nextafter(np.float32(recorded), np.float32(2.0))
    difference = replay(_changed(log, index, replace(entry.message, thrust_norm=thrust))).difference
    assert difference.topic == "control/target"
    assert difference.t_ns == entry.t_ns
    assert difference.field == "thrust_norm[1]"
    assert float(difference.recorded) == thrust[1]
    assert float(difference.replayed) == recorded


def test_a_changed_input_shows_in_the_first_output_that_feels_it(log):
    index = _nth(log, topics.MOCAP, 300)
    entry = log.entries[index]
    pos = entry.message.pos_lab_m + np.array([0.0, 0.001, 0.0])
    difference = replay(_changed(log, index, replace(entry.message, pos_lab_m=pos))).difference
    assert (difference.topic, difference.t_ns) == ("control/state", entry.t_ns)
    # The observer's activity is one for both horizontal axes, so a push in y is felt in x too.
    assert difference.field.startswith("pos_lab_m[0, ")


def test_a_missing_and_an_invented_output_are_named(log):
    index = _nth(log, topics.LINK_DOWN, 100)
    entry = log.entries[index]
    missing = replay(replace(log, entries=log.entries[:index] + log.entries[index + 1 :])).difference
    assert missing is not None
    twice = replay(replace(log, entries=[*log.entries[:index], entry, *log.entries[index:]])).difference
    assert (twice.topic, twice.t_ns) == ("link/down", entry.t_ns)


def test_a_log_without_its_configuration_or_outputs_is_not_identical(log):
    with pytest.raises(ReplayError, match="configuration"):
        replay(replace(log, metadata={}))
    with pytest.raises(ReplayError, match="no outputs to compare"):
        replay(replace(log, entries=[]))


def test_bits_are_compared_not_values():
    assert first_difference(0.0, -0.0, "x") == ("x", "0.0", "-0.0")
    assert first_difference(float("nan"), float("nan"), "x") is None
    assert first_difference(np.array([1.0, np.nan]), np.array([1.0, np.nan]), "x") is None
    assert first_difference(np.zeros(2), np.zeros(3), "x") == ("x", "float64(2,)", "float64(3,)")
    assert first_difference(b"ab", b"ac") == ("value", "b'ab'", "b'ac'")
