"""The host of studies against lockstep: the same seed, through MAVLink, links, guards and a simulated autopilot."""

import numpy as np
import pytest

from sim.studies.experiments import Experiment, Job, Score, fly
from sim.studies.host import Host

WITHIN = 0.02


@pytest.mark.parametrize("experiment", [Experiment.LINE, Experiment.CIRCLE, Experiment.GUST])
def test_a_flight_is_the_same_by_the_host_of_studies_as_in_lockstep(experiment: Experiment) -> None:
    study, lockstep = (fly(Job("cfc", experiment, 1, host=host)) for host in (Host.STUDY, Host.LOCKSTEP))
    assert numbers(study) == pytest.approx(numbers(lockstep), rel=WITHIN)


def numbers(score: Score) -> list[float]:
    """Lengths, m: RMS and vibration of a formation, deviation in a gust; the largest of all passes is one's luck."""
    in_gust = np.isfinite(score.gust.mean_dev_m)
    return [score.gust.mean_dev_m] if in_gust else [score.rms_m, score.vibration_m]
