"""Public flights: what is fitted is never judged; a vehicle of several flights; the summary's counts."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.identify.drag import Drag
from analysis.identify.signals import about
from analysis.identify.vehicle import NONE_COMMANDED, Identified
from analysis.load import Vehicle
from bench.real import FITTED, FORETOLD_MELLINGER, FORETOLD_PID, Row, judged, pooled
from formation.vehicle.profile import PROFILES
from sim.research.foretell import Errors, Foretold

BASE = PROFILES["crazyflie_27g"]


def test_no_flight_is_both_fitted_and_foretold_or_foretold_twice() -> None:
    flights = [
        (name, rep)
        for part in (FITTED, FORETOLD_PID, FORETOLD_MELLINGER)
        for name, reps in part.items()
        for rep in reps
    ]
    assert len(flights) == len(set(flights)) == 72


def test_a_vehicle_of_several_flights_has_the_medians_of_what_is_known() -> None:
    """Drag over mass of 0.2, 0.4, 0.5 1/s, and once 9 that is not known; all else stays."""
    vehicle = Vehicle("wasp", 1, 0)
    found = [
        Identified(vehicle, BASE, NONE_COMMANDED, NONE_COMMANDED,
                   Drag(about(value, deviation), about(0.0, 1.0), about(0.0, 1.0)), "")
        for value, deviation in ((0.2, 0.01), (0.4, 0.01), (0.5, 0.01), (9.0, 9.0))
    ]  # fmt: skip
    drag = 0.4 * BASE.mass_kg
    made = pooled(found, "wasp")
    assert made.thrust_max_n == pytest.approx(BASE.thrust_max_n)
    wanted = {"name": "wasp", "drag_n_s_m": (drag, drag, BASE.drag_n_s_m[2]), "thrust_max_n": made.thrust_max_n}
    assert made == BASE.model_copy(update=wanted)


def test_the_summary_counts_and_ranks() -> None:
    """Of three flights one is foretold by half too much; two figures come in the right order."""

    def of(rms_mm: float) -> Errors:
        return Errors(1e-3 * rms_mm, 0.0, 0.0, 0.0, ())

    none = Foretold("wasp", "law", "v", 1.0, 20.0, 0.0, 0.0, of(0.0), path_rms_m=0.05)
    told_mm = (("eight_slow", 1, 200, 210), ("eight_slow", 2, 250, 200), ("eight_medium", 1, 400, 600))
    rows = [
        Row(name, rep, replace(none, flown=of(flown), foretold=of(told))) for name, rep, flown, told in told_mm
    ]  # fmt: skip
    said = "\n".join(judged("PID", rows))
    assert "2 of 3 within 25%" in said
    assert f"median {np.median([0.05, -0.2, 0.5]):+.0%}" in said
    assert "slow before medium: 1 of 1" in said
    assert "differ by 25% (median)" in said
    assert rows[2].found.off_share == pytest.approx(0.5)
