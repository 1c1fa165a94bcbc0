"""A log's tables as files for other programs: CSV, or Parquet where pyarrow is installed; one file a topic."""

import csv
import json
from pathlib import Path

from analysis.tables.topic_tables import LogTables, Table
from wire.logs.mcap_read import LogError

WITHOUT_PYARROW = "--parquet needs pyarrow: pip install 'mavlink-formation[parquet]'"


def to_csv(log: LogTables, folder: Path) -> list[Path]:
    """One TOPIC.csv a table, and metadata.json; numbers with every digit they have, bytes in hexadecimal. OSError."""
    written = [_metadata(log, folder)]
    for topic, table in log.tables.items():
        path = folder / f"{_name(topic)}.csv"
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(table)
            writer.writerows(zip(*(_texts(column.tolist()) for column in table.values()), strict=True))
        written.append(path)
    return written


def to_parquet(log: LogTables, folder: Path) -> list[Path]:
    """One TOPIC.parquet a table, and metadata.json. OSError; LogError without pyarrow."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise LogError(WITHOUT_PYARROW) from error
    written = [_metadata(log, folder)]
    for topic, table in log.tables.items():
        path = folder / f"{_name(topic)}.parquet"
        pq.write_table(pa.table(_arrays(table)), path)
        written.append(path)
    return written


def _name(topic: str) -> str:
    return topic.replace("/", "-")


def _metadata(log: LogTables, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "metadata.json"
    path.write_text(json.dumps(dict(log.metadata), indent=2), encoding="utf-8")
    return path


def _texts(column: list[object]) -> list[object]:
    return [value.hex() for value in column if isinstance(value, bytes)] or column


def _arrays(table: Table) -> dict[str, object]:
    """Columns as pyarrow takes them: objects as lists of what they are."""
    return {name: column.tolist() if column.dtype == object else column for name, column in table.items()}
