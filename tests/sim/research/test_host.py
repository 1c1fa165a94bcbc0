"""The host of studies against lockstep: the same seed, through MAVLink, links, guards and a simulated autopilot."""

import numpy as np
import pytest

from analysis.metrics import summarise
from formation.vehicle.profile import PAPER_40G
from sim.faults.fault import Family, Fault
from sim.research import host, league
from sim.research.experiments import Experiment, Job, Score, fly
from sim.research.host import Host

WITHIN = 0.02


@pytest.mark.parametrize(
    "experiment", [Experiment.CIRCLE, Experiment.GUST, pytest.param(Experiment.LINE, marks=pytest.mark.nightly)]
)
def test_a_flight_is_the_same_by_the_host_of_studies_as_in_lockstep(experiment: Experiment) -> None:
    study, lockstep = (fly(Job("cfc", experiment, 1, host=host)) for host in (Host.STUDY, Host.LOCKSTEP))
    assert numbers(study) == pytest.approx(numbers(lockstep), rel=WITHIN)


def test_a_payload_is_carried_as_in_lockstep() -> None:
    """Sagging under it for a second is most of the error."""
    scenario = league.SCENES["payload on, off"](PAPER_40G)
    study, lockstep = (summarise(host.fly(scenario, 1, host=by)[1]) for by in (Host.STUDY, Host.LOCKSTEP))
    assert study.formation_max_m == pytest.approx(lockstep.formation_max_m, rel=WITHIN)
    assert study.formation_max_m is not None
    assert study.formation_max_m > 0.03


def test_a_fault_that_this_host_has_not_is_rejected() -> None:
    scenario = league.SCENES["line"](PAPER_40G)
    faulty = scenario.model_copy(update={"faults": (Fault(family=Family.DEAD_MOTOR),)})
    with pytest.raises(ValueError, match="the host of studies has no fault `dead-motor`"):
        host.fly(faulty, 1)


def numbers(score: Score) -> list[float]:
    """Lengths, m: RMS and vibration of a formation, deviation in a gust; the largest of all passes is one's luck."""
    in_gust = np.isfinite(score.gust.mean_dev_m)
    return [score.gust.mean_dev_m] if in_gust else [score.rms_m, score.vibration_m]
