"""How high the vehicles flew in formation, against what was commanded and configured."""

import numpy as np

from analysis.load import Flight
from analysis.page import cell, row, swatch, table
from analysis.plots import style
from analysis.tracking import reference_lab_m
from formation.messages import Phase

HEAD = ("vehicle", "#mean altitude, m", "#commanded, m", "#error, mm", "#take-off to, m")


def altitudes(flight: Flight) -> str:
    """One row a vehicle, over the formation phase; empty where it was not flown."""
    colours, rows = style.colours(len(flight.vehicles)), []
    for i, vehicle in enumerate(flight.vehicles):
        mean_m, commanded_m = _measured_m(flight, i), _commanded_m(flight, vehicle.column)
        if mean_m is None:
            continue
        error = "–" if commanded_m is None else f"{1e3 * (mean_m - commanded_m):+.2f}"
        commanded = "–" if commanded_m is None else f"{commanded_m:.4f}"
        configured = "–" if flight.run.lab is None else f"{flight.run.lab.flight.altitude_m:.3f}"
        numbers = (f"{mean_m:.4f}", commanded, error, configured)
        rows.append(row(swatch(vehicle.body, colours[i]), *(cell(number, "number") for number in numbers)))
    return table(HEAD, rows) if rows else ""


def _measured_m(flight: Flight, i: int) -> float | None:
    if not len(flight.poses):
        return None
    chosen = _in_formation(flight, flight.poses.t_s) & flight.poses.seen[:, i]
    return float(flight.poses.pos_lab_m[chosen, i, 2].mean()) if chosen.any() else None


def _commanded_m(flight: Flight, column: int | None) -> float | None:
    if column is None or not len(flight.reference):
        return None
    chosen = _in_formation(flight, flight.reference.t_s)
    return float(reference_lab_m(flight.reference)[chosen, column, 2].mean()) if chosen.any() else None


def _in_formation(flight: Flight, t_s: np.ndarray) -> np.ndarray:
    inside = np.zeros(len(t_s), dtype=bool)
    for span in flight.spans(Phase.FORMATION):
        inside |= (t_s >= span.start_s) & (t_s <= span.end_s)
    return inside
