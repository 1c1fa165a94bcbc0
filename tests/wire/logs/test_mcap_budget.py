"""A small file that asks for endless work is given up: what reading costs follows the file's size, not its claims."""

import struct
import zlib
from pathlib import Path

import pytest
import zstandard
from mcap.records import Channel, Schema
from mcap.writer import MCAP0_MAGIC

from formation import topics
from tests.wire.flight import check_log
from wire.logs.mcap_read import _entries
from wire.logs.mcap_scan import (
    BYTES_A_RECORD,
    RECORDS_LEAST,
    WORK_A_BYTE,
    WORK_LEAST,
    Damage,
    LogError,
    _Scanner,
)
from wire.logs.mcap_write import _record
from wire.schema import schema_of

SIZE = 8192
NAMED = (
    Schema(id=1, name="", encoding="", data=b""),
    Channel(id=1, topic=topics.TICK.name, message_encoding="protobuf", metadata={}, schema_id=0),
)


def chunk(claimed: int, crc: int, data: bytes) -> bytes:
    body = struct.pack("<QQQII4sQ", 0, 0, claimed, crc, 4, b"zstd", len(data)) + data
    return struct.pack("<BQ", 6, len(body)) + body


def bomb(raw: bytes, crc: int | None = None, claimed: int | None = None) -> bytes:
    packed = zstandard.ZstdCompressor(level=1).compress(raw)
    return chunk(len(raw) if claimed is None else claimed, zlib.crc32(raw) if crc is None else crc, packed)


def file_of(piece: bytes) -> bytes:
    head = MCAP0_MAGIC + b"".join(map(_record, NAMED))
    return head + piece * max(1, (SIZE - len(head)) // len(piece))


SMALLEST = struct.pack("<BQHIQQ", 5, 22, 1, 0, 0, 0)  # a message of a channel of ours, all defaults
MANY = 1 << 21
CRAFTED = {
    "sound bombs of messages": bomb(SMALLEST * (MANY // len(SMALLEST))),
    "sound bombs of nothing": bomb(bytes(MANY)),
    "bombs with a wrong checksum": bomb(bytes(MANY), crc=1),
    "claims of 2^63 bytes": bomb(bytes(MANY), claimed=1 << 63),
    "claims of less than there is": bomb(bytes(MANY), claimed=9),
    "heads inside heads": struct.pack("<BQQQQII4sQ", 6, 4000, 0, 0, 1 << 20, 1, 4, b"zstd", 3000),
    "signatures": b"\4\0\0\0zstd",
    "records of nothing": struct.pack("<BQ", 3, 0),
    "records that swallow the rest": struct.pack("<BQ", 3, 4000) + b"\4\0\0\0zstd" * 8,
}


class Counted(_Scanner):
    """The work that one reading asked for."""

    spent = 0

    def _spend(self, work: int) -> None:
        Counted.spent += work
        super()._spend(work)


@pytest.mark.parametrize("piece", CRAFTED.values(), ids=CRAFTED)
def test_a_crafted_file_costs_what_its_size_allows(
    piece: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Eight kilobytes cost 98 s: bombs were unpacked again and again, and every message in them read."""
    path = tmp_path / "x.mcap"
    data = file_of(piece)
    path.write_bytes(data)
    monkeypatch.setattr("wire.logs.mcap_scan._Scanner", Counted)
    Counted.spent = 0
    damage = Damage()
    read = sum(1 for _ in _entries(path, damage, topics.ALL))
    assert read <= RECORDS_LEAST + len(data) // BYTES_A_RECORD
    most = WORK_LEAST + WORK_A_BYTE * len(data)
    assert Counted.spent <= most + (1 << 26)  # the attempt that was refused was counted too
    assert len(damage.notes) <= 5


def test_a_frame_that_lies_about_its_size_is_not_unpacked(tmp_path: Path) -> None:
    """zstd gives a frame the size that its own head claims, whatever limit it is given."""
    head = b"\x28\xb5\x2f\xfd" + bytes([0xE0]) + struct.pack("<Q", 1 << 60)
    path = tmp_path / "x.mcap"
    path.write_bytes(file_of(chunk(1 << 20, 0, head + bytes(50))))
    assert not check_log(path).complete


def test_bombs_that_are_no_mcap_file_are_the_one_error(tmp_path: Path) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(bytes(8) + CRAFTED["bombs with a wrong checksum"] * 20)
    with pytest.raises(LogError, match="not an MCAP file"):
        check_log(path)


def test_a_list_of_ten_thousand_names_reads_in_one_pass() -> None:
    """Each name copied all names before it: 9.8 s for a frame of 10,000 empty ones."""
    schema = schema_of(topics.MOCAP.type)
    tag = next(tag for tag, field in schema.own.by_tag.items() if field.name == "bodies")
    frame = schema.decode(bytes([tag, 0]) * 1_000_000)
    assert len(frame.bodies) == 1_000_000
