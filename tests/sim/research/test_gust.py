"""The statistics of the gust, against a second way to compute them from the logged truth, in plain NumPy."""

import numpy as np
import pytest

from formation.codes import GOOD_RESULTS
from formation.messages import Phase
from formation.vehicle.profile import PAPER_40G
from sim.research import experiments, gust, host
from sim.research.experiments import Experiment, Job


def test_a_flights_numbers_are_those_of_its_truth() -> None:
    """Computed again from position, push and targets alone; the fan's passes from its end points at +-80 degrees."""
    job = Job("pid", Experiment.GUST, 1)
    scenario = experiments.scenario_of(job).model_copy(update={"formation_s": 15.0})
    result, flight = host.fly(scenario, 1)
    numbers = experiments.measure(flight, scenario, result, job.experiment).gust
    truth, fan = flight.truth[2], scenario.air.fan
    assert fan is not None
    x = truth["pos_lab_m"][:, 0]
    push = truth["dist_lab_m_s2"][:, 0]
    (span,) = flight.spans(Phase.FORMATION)
    assert np.abs(push[truth.t_s < fan.start_s + 0.2]).max() < 0.01  # it starts turned away, by 80 degrees
    turned_away = [fan.start_s + 2.0 * k for k in range(20) if fan.start_s + 2.0 * k <= span.end_s]
    assert len(turned_away) >= 3
    largest = [
        max(abs(xi) for xi, ti in zip(x, truth.t_s, strict=True) if begin <= ti < begin + 2.0)
        for begin in turned_away[:-1]
    ]
    assert numbers.mean_dev_m == pytest.approx(np.mean(largest), rel=1e-12)
    assert numbers.max_dev_m >= max(largest)
    assert all(np.abs(push[(truth.t_s >= t) & (truth.t_s < t + 2.0)]).max() > 1.0 for t in turned_away[:-1])
    calm = (flight.target.t_s > span.start_s + 1.0) & (flight.target.t_s < fan.start_s)
    asked = []
    sent = flight.target.where(calm)
    for (w, i, j, k), (p, q, _) in zip(sent["q_lab_from_flu"][:, 0], sent["rate_flu_rad_s"][:, 0], strict=True):
        rotation = np.array(
            [
                [1 - 2 * (j * j + k * k), 2 * (i * j - w * k), 2 * (i * k + w * j)],
                [2 * (i * j + w * k), 1 - 2 * (i * i + k * k), 2 * (j * k - w * i)],
                [2 * (i * k - w * j), 2 * (j * k + w * i), 1 - 2 * (i * i + j * j)],
            ]
        )
        asked.append(rotation @ np.array([q / PAPER_40G.attitude_p_1_s, -p / PAPER_40G.attitude_p_1_s, 1.0]))
    steps = np.linalg.norm(np.diff(asked, axis=0), axis=1)
    assert numbers.chatter_deg == pytest.approx(np.degrees(np.sqrt(np.mean(steps**2))), rel=1e-9)


def test_a_push_that_is_felt_on_board_moves_the_drone_less() -> None:
    """By a quarter, through HIGHRES_IMU, its noise, the link and the drone's clock."""
    moved_m = {}
    for controller in ("cfc", "cfc_imu"):
        scenario = experiments.scenario_of(Job(controller, Experiment.GUST, 1)).model_copy(update={"formation_s": 12.0})
        result, flight = host.fly(scenario, 1)
        assert result in GOOD_RESULTS
        moved_m[controller] = gust.gust_numbers(flight, scenario).mean_dev_m
    assert moved_m["cfc_imu"] < 0.8 * moved_m["cfc"]
