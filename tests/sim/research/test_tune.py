import math

import pytest

from sim.research import tune
from sim.research.experiments import Experiment, Score
from sim.research.gust import GustNumbers
from sim.research.push import Settling


def a_score(outcome: str = "landed", dev: float = 0.04, chatter: float = 0.3, rms: float = 0.001) -> Score:
    gust, push = (
        GustNumbers(0.5 * dev, dev, 0.2, 0.1, 0.05, chatter),
        Settling(outcome, swing_deg=0.5, settle_s=1.0, deviation_m=0.1),
    )
    return Score(outcome, gust, push, rms, 0.001, None)


def test_a_flight_as_wanted_costs_one_for_each_thing_wanted() -> None:
    assert tune.cost_of(a_score(), Experiment.GUST) == pytest.approx(2.0)
    assert tune.cost_of(a_score(), Experiment.CIRCLE) == pytest.approx(1.0)
    assert tune.cost_of(a_score(), Experiment.PUSH) == pytest.approx(2.0)
    assert tune.cost_of(a_score(outcome="aborted"), Experiment.CIRCLE) == math.inf
    assert tune.cost_of(a_score(rms=math.nan), Experiment.CIRCLE) == math.inf
