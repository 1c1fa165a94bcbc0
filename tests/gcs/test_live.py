"""A log on the bus: whoever listens gets the log's own bytes; the file is the same whether anybody does."""

from io import BytesIO
from pathlib import Path

import pytest
from mcap.reader import make_reader

from formation import topics
from formation.messages import Event, Severity, Tick
from gcs.live import Live
from wire.logs.live import HEAD_EVERY, ChannelDescription, keys, sharer
from wire.logs.mcap_write import LogWriter

HEAD, CHUNK = keys("main")


class FakeBus:
    """Keeps what is put, while it is heard."""

    def __init__(self, heard: bool) -> None:
        self.heard = heard
        self.sent: list[tuple[str, bytes]] = []

    def publish(self, key: str, payload: bytes, attachment: bytes | None = None) -> None:
        self.sent.append((key, payload))

    def has_subscribers(self, key: str) -> bool:
        return self.heard


class Seen:
    """A viewer that keeps what it is shown."""

    def __init__(self) -> None:
        self.begun: list[dict[int, ChannelDescription]] = []
        self.shown: list[tuple[str, int, bytes]] = []

    def begin(self, channels) -> None:
        self.begun.append(dict(channels))

    def show(self, channel: int, unix_ns: int, data: bytes) -> None:
        self.shown.append((self.begun[-1][channel].topic, unix_ns, data))

    def close(self) -> None:
        pass


def record(path: Path, bus: FakeBus, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("wire.logs.mcap_write._CHUNK_MESSAGES", 10)
    with LogWriter(path, {"seed": "1"}, threaded=False, share=sharer(bus, "main")) as log:
        for k in range(600):
            log.write(topics.TICK, Tick(k), k)
            if k % 100 == 0:
                log.write(topics.EVENT, Event(Severity.INFO, "gcs", f"event {k}"), k)


def in_file(path: Path) -> list[tuple[str, int, bytes]]:
    messages = make_reader(BytesIO(path.read_bytes())).iter_messages()
    return [(channel.topic, m.log_time, m.data) for _, channel, m in messages]


def test_a_viewer_is_shown_the_very_messages_of_the_log_from_the_next_head_on(tmp_path, monkeypatch) -> None:
    bus, late = FakeBus(heard=True), Seen()
    record(tmp_path / "flight.mcap", bus, monkeypatch)
    seen, log = Seen(), in_file(tmp_path / "flight.mcap")
    for viewer, sent in ((seen, bus.sent), (late, bus.sent[10:])):
        live = Live(viewer, lambda _text: None)
        for key, payload in sent:
            (live.receive_head if key == HEAD else live.receive_chunk)(payload)
    assert sorted(seen.shown) == sorted(log)
    assert len(seen.begun) == 1
    assert sum(key == HEAD for key, _ in bus.sent) >= sum(key == CHUNK for key, _ in bus.sent) // HEAD_EVERY
    assert 0 < len(late.shown) < len(log)
    assert late.shown[-1] == log[-1]


def test_nothing_is_shared_while_nobody_listens_and_the_file_is_the_same(tmp_path, monkeypatch) -> None:
    silent, heard = FakeBus(heard=False), FakeBus(heard=True)
    record(tmp_path / "a.mcap", silent, monkeypatch)
    record(tmp_path / "b.mcap", heard, monkeypatch)
    assert silent.sent == []
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
