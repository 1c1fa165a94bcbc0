"""A folder of flights as a catalogue: a row a log, for people, as JSON or as a table of SQLite."""

import sqlite3
from collections.abc import Iterable, Iterator
from dataclasses import astuple, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path

from analysis.load import load_checked
from analysis.metrics import summarise
from formation.clock_pair import SIMULATED
from formation.messages import Severity
from wire.errors import error_text
from wire.files import is_partial
from wire.logs.mcap_read import clock_of
from wire.logs.mcap_scan import LogError, NoFlightError


@dataclass(frozen=True, slots=True)
class CatalogueRow:
    """One flight; what its log does not have is None. date: UTC, ISO 8601, when it began, or of a flight in simulated
    time when its file was written; simulated: the date on its own clock. unfinished: being recorded, or its writer was
    killed.

    faults: how many of its events were errors or worse. damage: of its log; the rest is what could be read.
    """

    path: str
    date: str | None = None
    lab: str | None = None
    duration_s: float | None = None
    outcome: str | None = None
    formation_rms_m: float | None = None
    formation_max_m: float | None = None
    faults: int | None = None
    damage: str = ""
    simulated: str | None = None
    unfinished: bool = False


def catalogue(folder: Path) -> Iterator[CatalogueRow]:
    """Every log below the folder (or the one that it is), by name: runs begin with their date."""
    for path in [folder] if folder.is_file() else sorted(folder.rglob("*.mcap")):
        yield _row(path)


def _row(path: Path) -> CatalogueRow:
    try:
        flight, checked = load_checked(path)
        summary = summarise(flight)
    except NoFlightError:
        return CatalogueRow(str(path), unfinished=is_partial(path))
    except (LogError, OSError) as error:
        return CatalogueRow(str(path), damage=error_text(error))
    lab, date = flight.run.lab, flight.run.metadata.get("date")
    simulated = None if date is not None and clock_of(flight.run.metadata) != SIMULATED else date
    if simulated == date:
        date = f"{datetime.fromtimestamp(int(path.stat().st_mtime), UTC):%Y-%m-%dT%H:%M:%SZ}"
    return CatalogueRow(
        path=str(path),
        date=date,
        simulated=simulated,
        unfinished=is_partial(path),
        lab=flight.run.scenario or (None if lab is None else lab.name),
        duration_s=round(summary.duration_s, 2),
        outcome=str(summary.outcome),
        formation_rms_m=summary.formation_rms_m,
        formation_max_m=summary.formation_max_m,
        faults=sum(event.severity <= Severity.ERROR for event in flight.events.messages),
        damage="" if checked.complete or is_partial(path) else checked.damage,
    )


def over(rows: Iterable[CatalogueRow], most_bytes: float) -> Iterator[Path]:
    """The oldest logs that have to go for the others to fill so much at most; what is damaged, or not whole, stays."""
    dated = sorted(
        ((row.date, Path(row.path)) for row in rows if row.date is not None and not row.damage and not row.unfinished),
        reverse=True,
    )
    filled = 0
    for _, path in dated:
        filled += path.stat().st_size
        if filled > most_bytes:
            yield path


def write_sqlite(rows: Iterable[CatalogueRow], file: Path) -> None:
    """The rows as table `flights`, in the place of what it held; sqlite3.Error."""
    names = [field.name for field in fields(CatalogueRow)]
    with sqlite3.connect(file) as database:
        database.execute("DROP TABLE IF EXISTS flights")
        database.execute(f"CREATE TABLE flights ({', '.join(names)})")
        database.executemany(f"INSERT INTO flights VALUES ({', '.join('?' * len(names))})", map(astuple, rows))
    database.close()
