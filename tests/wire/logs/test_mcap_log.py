"""The flight recorder: what is written comes back, from whole, truncated, damaged and killed files."""

import dataclasses
import errno
import signal
import subprocess
import sys
import threading
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from mcap_protobuf.decoder import DecoderFactory

from formation import messages as m
from formation import topics
from tests.wire import flight as wire_flight
from tests.wire.flight import check_log
from tests.wire.spine import SPINE, assert_column, assert_identical
from wire.files import recorded
from wire.logs.mcap_read import read_columns, read_log
from wire.logs.mcap_scan import LogError
from wire.logs.mcap_write import LogWriter


def entries_of(path: Path) -> list[tuple[str, int, object]]:
    return [(entry.topic.name, entry.t_ns, entry.message) for entry in read_log(path).entries]


def assert_prefix(read, written) -> None:
    """`read` is how `written` begins."""
    assert [(name, t) for name, t, _ in read] == [(name, t) for name, t, _ in written[: len(read)]]
    for (_, _, theirs), (_, _, ours) in zip(read, written, strict=False):
        assert_identical(ours, theirs)


FRAMES = 60
CHUNK = 40


@pytest.fixture(scope="module")
def flight(tmp_path_factory) -> tuple[Path, list, bytes]:
    """A short flight in small chunks: its file, what was written, its bytes."""
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wire.logs.mcap_write._CHUNK_MESSAGES", CHUNK)
        written = wire_flight.record(path, FRAMES)
    return path, written, path.read_bytes()


@pytest.mark.parametrize("threaded", [False, True])
def test_what_is_written_is_read_in_order(tmp_path, threaded):
    path = tmp_path / "flight.mcap"
    written = wire_flight.record(path, 120, threaded=threaded)
    read = entries_of(path)
    assert len(read) == len(written)
    assert_prefix(read, written)
    log = read_log(path)
    assert [next(log.entries).t_ns for _ in range(2)] == [0, 0]
    check = check_log(path)
    assert (check.complete, check.damage) == (True, "")
    assert check.entries == {"mocap/frame": 120, "input/tick": 120, "link/down": 120, "event": 3}
    assert (check.first_ns, check.last_ns) == (0, 1_190_000_000)


RECORDED = [topic for topic in topics.ALL if topic not in (topics.MOCAP, topics.EVENT)]  # views are made of those


@settings(suppress_health_check=list(HealthCheck), max_examples=5, deadline=None)
@given(st.tuples(*(SPINE[topic.type] for topic in RECORDED)), st.integers(0, 2**63))
def test_every_topic_is_recorded_bit_for_bit(tmp_path, messages, t_ns):
    path = tmp_path / "one.mcap"
    with LogWriter(path, {}, threaded=False, overwrite=True) as log:
        for topic, message in zip(RECORDED, messages, strict=True):
            log.write(topic, message, t_ns)
    read = entries_of(path)
    assert_prefix(read, [(topic.name, t_ns, message) for topic, message in zip(RECORDED, messages, strict=True)])
    assert len(read) == len(messages)
    names = {topic: [field.name for field in dataclasses.fields(topic.type)] for topic in RECORDED}
    found = read_columns(path, names).topics
    for topic, message in zip(RECORDED, messages, strict=True):
        for name in names[topic]:
            assert_column(found[topic].fields[name], [message], name)


def test_the_mcap_librarys_own_reader_agrees(flight):
    path, written, _ = flight
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        statistics = reader.get_summary().statistics
        frames = [proto for _, _, _, proto in reader.iter_decoded_messages(topics=["mocap/frame"])]
    assert statistics.message_count == len(written) + 2  # and the events as Foxglove's log lines
    assert [f.seq for f in frames] == list(range(FRAMES))
    assert list(frames[3].pos_lab_m) == wire_flight.frame(3).pos_lab_m.ravel().tolist()
    assert list(frames[3].bodies) == ["leader", "a", "b"]


@pytest.mark.parametrize("packed", [*CompressionType, None])
def test_a_log_rewritten_by_public_tools_holds_the_same(flight, tmp_path, packed):
    """packed: how its chunks are; None: it has none."""
    path, written, _ = flight
    copy = tmp_path / "copy.mcap"
    with path.open("rb") as file, copy.open("wb") as out:
        reader = make_reader(file)
        writer = Writer(out, compression=packed or CompressionType.NONE, use_chunking=packed is not None)
        writer.start()
        for metadata in reader.iter_metadata():
            writer.add_metadata(metadata.name, metadata.metadata)
        channels: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages():
            if channel.id not in channels:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()
    read = entries_of(copy)
    assert len(read) == len(written)
    assert_prefix(read, written)
    assert check_log(copy).damage == ""


def test_a_long_flight_takes_no_memory_and_every_chunk_is_in_the_summary(tmp_path, monkeypatch):
    """46 chunks a second are 165,600 an hour, so that 6 bytes a chunk are 1 MB an hour."""
    chunks = 6000
    monkeypatch.setattr("wire.logs.mcap_write._CHUNK_MESSAGES", 1)
    path = tmp_path / "long.mcap"
    log = LogWriter(path, {}, threaded=False)
    tracemalloc.start()
    try:
        for k in range(chunks):
            log.write(topics.TICK, m.Tick(k), k)
            if 2 * k == chunks:
                before = tracemalloc.get_traced_memory()[0]
        grown = tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
    log.close()
    assert grown < 6 * chunks / 2
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert len(summary.chunk_indexes) == summary.statistics.chunk_count == chunks
    assert summary.statistics.message_end_time - summary.statistics.message_start_time == chunks - 1


def offsets(data: bytes) -> list[int]:
    """Every byte of the head and of the tail, and some of the middle."""
    size = len(data)
    return [*range(1, 150), *range(150, size - 150, size // 300), *range(size - 150, size)]


def test_a_file_truncated_anywhere_gives_its_beginning(flight):
    path, written, data = flight
    cut = path.with_name("cut.mcap")
    longest = 0
    for size in offsets(data):
        cut.write_bytes(data[:size])
        try:
            read = entries_of(cut)
        except LogError:
            assert size < 8
            continue
        assert_prefix(read[-3:], written[max(0, len(read) - 3) :])
        assert len(read) >= longest
        longest = max(longest, len(read))
        check = check_log(cut)
        assert not check.complete
        assert check.damage
        if size >= 400:  # so that a file cut short still says what it is
            assert read_log(cut).metadata.items() >= wire_flight.METADATA.items()
        assert sum(check.entries.values()) == len(read)
    assert longest == len(written)


@pytest.mark.parametrize("change", [0x01, 0x80, 0xFF])
def test_a_damaged_byte_anywhere_costs_at_most_its_chunk_and_is_told(flight, change):
    path, written, data = flight
    bad = path.with_name("bad.mcap")
    for at in offsets(data)[:: 3 if change == 0xFF else 11]:
        damaged = bytearray(data)
        damaged[at] ^= change
        bad.write_bytes(damaged)
        read = read_log(bad)
        count = sum(1 for _ in read.entries)
        assert count >= len(written) - CHUNK, at
        assert count <= len(written)
        check = check_log(bad)
        assert check.entries
        if at < data.rindex(b"\x0f\x04\0\0\0\0\0\0\0"):  # before the end of the data, which has a checksum
            assert not check.complete, at
            assert check.damage, at


@settings(max_examples=50, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
@given(data=st.data())
def test_any_edit_of_a_file_is_read_or_the_one_error(flight, data):
    path, _, whole = flight
    start = data.draw(st.integers(0, len(whole)))
    edited = whole[:start] + data.draw(st.binary(max_size=200)) + whole[start + data.draw(st.integers(0, 5000)) :]
    odd = path.with_name("odd.mcap")
    odd.write_bytes(edited)
    try:
        check = check_log(odd)
    except LogError:
        return
    assert sum(check.entries.values()) == sum(1 for _ in read_log(odd).entries)


@pytest.mark.parametrize("content", [b"", b"x", b"hello, this is no log", bytes(5000)])
def test_what_is_no_log_is_the_one_error(tmp_path, content):
    path = tmp_path / "no.mcap"
    path.write_bytes(content)
    for read in (read_log, check_log):
        with pytest.raises(LogError, match=r"no\.mcap"):
            read(path)


def test_kill_9_costs_only_the_newest_moments(tmp_path):
    path = tmp_path / "killed.mcap"
    script = [sys.executable, wire_flight.__file__, str(path)]
    with subprocess.Popen(script, stdout=subprocess.PIPE, text=True) as process:
        lines = [process.stdout.readline()]
        while int(lines[-1]) - int(lines[0]) < 2_000_000_000:
            lines.append(process.stdout.readline())
        process.send_signal(signal.SIGKILL)
        lines += process.stdout.readlines()
    assert process.returncode == -signal.SIGKILL
    logged = [int(line) for line in lines if line.endswith("\n")]
    assert recorded(path) == tmp_path / "killed.partial.mcap"  # it is not whole, and does not look so
    check = check_log(recorded(path))
    assert not check.complete
    assert check.first_ns == logged[0]
    # 50 ms on a machine with a core to spare (chunks every 20 ms); the bound leaves room for a busy one.
    assert logged[-1] - check.last_ns <= 1_000_000_000
    assert [entry.t_ns for entry in read_log(recorded(path)).entries] == logged[: check.entries["input/tick"]]


def test_a_disk_that_cannot_keep_up_costs_what_may_be_lost_only(tmp_path, monkeypatch):
    path = tmp_path / "slow.mcap"
    monkeypatch.setattr("wire.logs.mcap_write._PENDING_MESSAGES", 10)
    with LogWriter(path, {}, threaded=False) as log:
        for i in range(100):
            log.write(topics.LINK_UP, m.Datagram(1, b"x"), i)
            log.write(topics.TICK, m.Tick(i), i)
    assert log.lost == 94
    check = check_log(path)
    assert check.entries == {"link/up": 6, "input/tick": 100}
    assert check.damage == "94 messages were dropped while recording"


def test_a_stamp_before_time_began_is_refused(tmp_path):
    with LogWriter(tmp_path / "x.mcap", {}, threaded=False) as log, pytest.raises(ValueError, match="-1"):
        log.write(topics.TICK, m.Tick(0), -1)


class _Disk:
    """A disk that is full, or so slow that a write ends only when it is told to."""

    def __init__(self, error: OSError | None = None) -> None:
        self.error, self.entered, self.go_on = error, threading.Event(), threading.Event()

    def write(self, data: bytes) -> int:
        self.entered.set()
        if self.error is not None:
            raise self.error
        self.go_on.wait(30.0)
        return len(data)


def test_a_full_disk_is_trouble_in_words_at_once(tmp_path):
    log = LogWriter(tmp_path / "flight.mcap", {}, threaded=False)
    assert log.trouble(0) == ""
    log._file._stream = _Disk(OSError(errno.ENOSPC, "No space left on device"))
    log.write(topics.TICK, m.Tick(7), 7)
    log._drain()
    assert log.trouble(8) == "nothing more is recorded in flight.partial.mcap: No space left on device"
    with pytest.raises(OSError, match="No space left"):
        log.close()
    assert log.lost == 1


def test_a_slow_disk_is_trouble_after_half_a_second_and_none_once_it_has_caught_up(tmp_path):
    log, disk = LogWriter(tmp_path / "flight.mcap", {}), _Disk()
    stream, log._file._stream = log._file._stream, disk
    log.write(topics.TICK, m.Tick(7), 1_000_000_000)
    assert disk.entered.wait(30.0)
    assert log.trouble(1_500_000_000) == ""
    assert "flight.partial.mcap is too slow" in log.trouble(1_500_000_001)
    log._file._stream = stream
    disk.go_on.set()
    log.close()
    assert log.trouble(10**12) == ""
