"""The figures that the manual gives, measured small, and the tables of the study that ships."""

import numpy as np
import pytest

from bench import calibrate_fan
from formation.vehicle.profile import profile
from sim.studies import paper
from sim.studies.experiments import CONTROLLERS, gust_peak_m_s2
from sim.studies.mismatch import MISMATCHES
from tools.figures import paper_tables, stop_at_loss


def test_a_stop_reaches_every_drone_at_twenty_percent_loss_within_a_tenth_of_a_second():
    taken_s = stop_at_loss.times_s(2000, 0.2, seed=3)
    assert np.isfinite(taken_s).all()
    assert np.quantile(taken_s, 0.999) <= 0.1
    assert np.median(stop_at_loss.times_s(50, 0.95, seed=3)) > 0.05  # a link that loses nearly all is another matter


@pytest.mark.parametrize("vehicle", paper_tables.VEHICLES)
def test_what_was_flown_is_the_study_that_ships(vehicle: str) -> None:
    """Every row in the fan of today, in which the printed ISTSMC deviates by the paper's 0.30 m.

    On single seeds it scatters by more than the 20 mm: it swings by itself.
    """
    flown = paper.from_json(paper_tables.kept(vehicle).read_text(encoding="utf-8"))
    assert (flown.vehicle, flown.gust_peak_m_s2) == (vehicle, gust_peak_m_s2(profile(vehicle)))
    assert list(flown.controllers) == list(CONTROLLERS)
    assert list(flown.mismatches) == list(MISMATCHES)
    if len(flown.seeds) >= len(calibrate_fan.SEEDS):
        assert flown.controllers["istsmc"].gust_mean_dev_m == pytest.approx(0.30, abs=0.02)
