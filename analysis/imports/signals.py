"""One recording and its map -> our quantities, in lab and flu, SI; what the map does not name stays as it was."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter

import numpy as np

from analysis.imports.maps import PULSE_NONE, QUANTITIES, ImportMap, Kind, Quantity, Signal
from analysis.imports.recording import Recording, Table
from analysis.series import Sampled
from formation.maths import frames
from formation.maths.arrays import Float
from formation.model import UNIT_WITHIN
from wire.errors import ConfigError
from wire.mavlink import axes

COMMANDED = "commanded_"
"""Quantities of which columns that stay the same to the last bit in the whole file were never written."""


@dataclass(frozen=True, slots=True, eq=False)
class Imported:
    """One vehicle's file. quantities: by the name in `QUANTITIES`; others: what the map names nothing of, by table."""

    body: str
    recording: Recording
    title: str
    quantities: Mapping[str, Sampled]
    others: Mapping[str, Table]


def imported(recording: Recording, by: ImportMap, body: str) -> Imported:
    """The recording by a map; ConfigError where nothing that the map names is there."""
    columns, quantities, used = recording.columns(), dict[str, Sampled](), set[str]()
    for signal in by.signals:
        if signal.quantity in quantities:
            continue
        names = [name.removeprefix("-") for name in signal.columns]
        if all(name in columns for name in names):
            found = _sampled(recording, signal, names, columns, signal.axes or by.axes)
            if len(found.t_s):
                quantities[signal.quantity] = found
                used.update(names)
    if not quantities:
        raise ConfigError([f"{recording.path}: has no column that {by.title} names"])
    return Imported(body, recording, by.title, quantities, _others(recording, used))


def _sampled(
    recording: Recording, signal: Signal, names: list[str], columns: Mapping[str, tuple[str, str]], world: str
) -> Sampled:
    """The quantity at the stamps of its first column; columns of other tables are interpolated."""
    of, first = QUANTITIES[signal.quantity], columns[names[0]][0]
    t_s, once = np.unique(recording.tables[first].t_s, return_index=True)
    signs = np.array([-1.0 if name.startswith("-") else 1.0 for name in signal.columns])
    raw = signs * np.stack([_column(recording, first, *columns[name])[once] for name in names], axis=1)
    is_there = np.isfinite(raw).all(axis=1)
    if of.kind is Kind.ATTITUDE and raw.shape[1] == 4:
        is_there &= np.abs(np.linalg.norm(np.where(is_there[:, None], raw, 0.0), axis=1) - 1.0) < UNIT_WITHIN
    if signal.quantity.startswith(COMMANDED) and len(raw) > 1 and not (raw[is_there] != raw[is_there][:1]).any():
        is_there[:] = False
    return Sampled(t_s[is_there], _ours(of, signal, raw[is_there], is_ned=world == "ned"))


def _column(recording: Recording, first: str, name: str, column: str) -> Float:
    """A column of the table `name` at the stamps of the table `first`."""
    rows = recording.tables[name]
    values = np.asarray(rows.columns[column], np.float64)
    if name == first:
        return values
    t_s, once = np.unique(rows.t_s, return_index=True)
    return Sampled(t_s, values[once, None]).at(recording.tables[first].t_s)[:, 0]


def _ours(of: Quantity, signal: Signal, raw: Float, is_ned: bool) -> Float:
    """Values (T, w) in our units and axes."""
    if of.kind is Kind.ATTITUDE and raw.shape[1] == 4:
        values = frames.canonical(raw[:, [3, 0, 1, 2]] if signal.order == "xyzw" else raw)
    else:
        values = raw * of.units.get(signal.unit, 1.0) + (PULSE_NONE if signal.unit == "us" else 0.0)
        if of.kind is Kind.ATTITUDE:
            values = frames.from_euler(*values.T)
    if not is_ned or of.kind is Kind.SCALAR:
        return values
    return -values if of.kind is Kind.HEADING else axes.lab_of(values)


def _others(recording: Recording, used: Collection[str]) -> dict[str, Table]:
    """The tables without the columns that were used."""
    left = [each for name, each in recording.columns().items() if name not in used]
    tables = {}
    for name, columns in groupby(left, key=itemgetter(0)):
        rows = recording.tables[name]
        tables[name] = Table(rows.t_s, {column: rows.columns[column] for _, column in columns})
    return tables
