"""The pushes of a flight in formation, and how each vehicle met them (formation.estimation.push)."""

from collections.abc import Iterator

import numpy as np

from analysis.load import Flight, Vehicle
from analysis.series import nearest
from analysis.tracking import MATCH_S, reference_lab_m
from formation.estimation.push import CALM_S, SETTLED_M, Flown, Push, pushes
from formation.messages import Phase

PIECE_S = 20.0
"""So much is smoothed at once: a long flight's memory is bounded."""


def found(flight: Flight) -> list[tuple[Vehicle, Push]]:
    """Every push of a commanded vehicle in formation, in order of time; none where the log does not hold its lab."""
    lab = flight.run.lab
    if lab is None or not len(flight.reference) or not len(flight.poses):
        return []
    delay_s = float(np.median(flight.poses.received_s - flight.poses.t_s))
    every = [
        (flight.vehicles[i], push)
        for i in lab.commanded
        for begin_s, end_s, piece in _pieces(flight, i)
        for push in pushes(piece, lab.profile_of(lab.vehicles[i]), delay_s, lab.limits.tilt_rad)
        if begin_s <= push.begin_s < end_s
    ]
    return sorted(every, key=lambda each: each[1].begin_s)


def _pieces(flight: Flight, index: int) -> Iterator[tuple[float, float, Flown]]:
    """Stretches in formation in which a vehicle was off its reference, and each with what was before and after it."""
    poses, reference, column = flight.poses, flight.reference, flight.vehicles[index].column
    matched = nearest(reference.t_s, poses.t_s)
    usable = poses.seen[:, index] & (np.abs(reference.t_s[matched] - poses.t_s) <= MATCH_S)
    usable &= np.append(True, np.diff(poses.t_s) > 0.0)
    at = np.flatnonzero(usable)
    t_s, error_m = poses.t_s[at], poses.pos_lab_m[at, index] - reference_lab_m(reference)[matched[at], column]
    off = np.linalg.norm(error_m[:, :2], axis=1) > SETTLED_M
    for span in flight.spans(Phase.FORMATION):
        for begin_s in np.arange(span.start_s, span.end_s, PIECE_S).tolist():
            end_s = min(begin_s + PIECE_S, span.end_s)
            inside = (t_s >= begin_s - 2.0 * CALM_S) & (t_s <= min(end_s + 2.0 * CALM_S, span.end_s))
            if off[inside].any():
                pos_lab_m, q_lab_from_flu = poses.pos_lab_m[at[inside], index], poses.q_lab_from_flu[at[inside], index]
                yield begin_s, end_s, Flown(t_s[inside], pos_lab_m, q_lab_from_flu, error_m[inside])
