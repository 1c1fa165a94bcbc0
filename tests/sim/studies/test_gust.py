"""The statistics of the gust, against a second way to compute them from the logged truth, in plain NumPy."""

from collections.abc import Sequence

import numpy as np
import pytest

from formation.messages import Phase
from formation.vehicle.profile import PAPER_40G
from sim import lockstep
from sim.studies import experiments, gust
from sim.studies.experiments import Experiment, Job
from sim.studies.mismatch import MISMATCHES, mismatched


def pulses(times_s: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """10 s at 100 Hz, and a push of 0.4 s at each of the times."""
    t_s = np.arange(0.0, 10.0, 0.01)
    push = np.zeros_like(t_s)
    for start_s in times_s:
        push[(t_s >= start_s) & (t_s < start_s + 0.4)] = 3.0
    return t_s, push


def test_settling_is_taken_push_by_push() -> None:
    """First push: 5 cm at most, within 1 cm from 0.3 s after it; second: 3 cm, never back before the third."""
    t_s, push = pulses((1.0, 3.0, 5.0))
    deviation = np.zeros_like(t_s)
    deviation[(t_s >= 1.1) & (t_s < 1.7)] = 0.05
    deviation[(t_s >= 3.1) & (t_s < 5.0)] = 0.03
    passes = gust.pushes(push)
    assert len(passes) == 3
    assert gust.settling(t_s, deviation, passes) == pytest.approx((0.3 + 1.6 + 0.0) / 3, abs=0.02)


def test_nothing_pushed_gives_no_number() -> None:
    assert np.isnan(gust.settling(np.arange(10.0), np.zeros(10), []))
    assert np.isnan(gust.mean_of_largest(np.arange(10.0), np.zeros(10), []))


def test_the_largest_of_each_pass_are_averaged() -> None:
    t_s, _ = pulses(())
    deviation = np.where(np.isclose(t_s, 1.5), 0.3, np.where(np.isclose(t_s, 2.5), 0.1, 0.0))
    assert gust.mean_of_largest(t_s, deviation, [(1.0, 2.0), (2.0, 3.0), (3.0, 4.0)]) == pytest.approx(0.4 / 3)


def test_chatter_is_that_of_the_attitude_and_of_the_rates_over_the_attitude_gain() -> None:
    """By hand: a roll of +-1 degree a tick is 2 degrees; rates of +-0.1 rad/s at a gain of 10/s as much as 1.15."""
    half = np.radians(0.5) * np.array([1.0, -1.0] * 50)
    rolled = np.stack([np.cos(half), np.sin(half), 0.0 * half, 0.0 * half], axis=-1)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (100, 1))
    rates = np.zeros((100, 3))
    rates[:, 1] = np.tile([0.1, -0.1], 50)
    assert gust.chatter_deg(rolled, np.zeros((100, 3)), 10.0) == pytest.approx(2.0, rel=1e-3)
    assert gust.chatter_deg(still, rates, 10.0) == pytest.approx(np.degrees(0.02))
    about_z = np.zeros((100, 3))
    about_z[:, 2] = np.tile([1.0, -1.0], 50)
    assert gust.chatter_deg(still, about_z, 10.0) == 0.0
    opposed = np.zeros((100, 3))
    opposed[:, 0] = -10.0 * 2.0 * half
    assert gust.chatter_deg(rolled, opposed, 10.0) < 0.01  # rates that take back what the attitude asks for


def test_a_flights_numbers_are_those_of_its_truth() -> None:
    """Computed again from position, push and targets alone; the fan's passes from its end points at +-80 degrees."""
    job = Job("pid", Experiment.GUST, 1)
    scenario = experiments.scenario_of(job).model_copy(update={"formation_s": 15.0})
    flown, flight = lockstep.run_and_load(scenario, 1)
    numbers = experiments.measure(flight, scenario, flown.outcome.result, job.experiment).gust
    truth, fan = flight.truth[2], scenario.air.fan
    assert fan is not None
    x = np.array([message.pos_lab_m[0] for message in truth.messages])
    push = np.array([message.dist_lab_m_s2[0] for message in truth.messages])
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
    for message in (m for m, inside in zip(flight.target.messages, calm, strict=True) if inside):
        w, i, j, k = message.q_lab_from_flu[0]
        p, q, _ = message.rate_flu_rad_s[0]
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


@pytest.mark.parametrize("name", MISMATCHES)
def test_a_mismatched_vehicle_is_a_body_that_can_fly_and_that_nobody_told_the_ground_of(name: str) -> None:
    """Its inertia obeys the triangle inequality and stays within its arms; it can hover with a third to spare."""
    usual = experiments.scenario_of(Job("cfc", Experiment.GUST, 1))
    scenario = mismatched(usual, name)
    assert scenario.lab == usual.lab
    assert scenario != usual
    true = PAPER_40G.model_copy(update=dict(scenario.true_vehicle(2).vehicle))
    jx, jy, jz = true.inertia_kg_m2
    assert min(jx + jy - jz, jy + jz - jx, jz + jx - jy) >= 0.0
    assert np.sqrt(max(jx, jy) / true.mass_kg) < 0.5 * true.wheelbase_m
    assert true.thrust_max_n > 4.0 / 3.0 * true.weight_n
    assert scenario == experiments.scenario_of(Job("cfc", Experiment.GUST, 1, mismatch=name))


def test_a_push_that_is_felt_on_board_moves_the_drone_less() -> None:
    """By a quarter, through HIGHRES_IMU, its noise, the link and the drone's clock."""
    moved_m = {}
    for controller in ("cfc", "cfc_imu"):
        scenario = experiments.scenario_of(Job(controller, Experiment.GUST, 1)).model_copy(update={"formation_s": 8.0})
        flown, flight = lockstep.run_and_load(scenario, 1)
        assert flown.outcome.result == "landed"
        moved_m[controller] = gust.gust_numbers(flight, scenario).mean_dev_m
    assert moved_m["cfc_imu"] < 0.8 * moved_m["cfc"]


def test_the_mismatches_are_what_their_names_say() -> None:
    usual = experiments.scenario_of(Job("cfc", Experiment.GUST, 1))
    late = mismatched(usual, "double delay")
    assert (late.mocap.delay_s, late.link.down_s, late.link.up_s) == (0.016, 0.008, 0.008)
    assert late.true_vehicle(2).vehicle["command_delay_s"] == 2.0 * PAPER_40G.command_delay_s
    heavy = mismatched(usual, "heavy and slow").true_vehicle(2).vehicle
    assert heavy["mass_kg"] == pytest.approx(0.052)
    assert heavy["attitude_p_1_s"] == pytest.approx(11.0 / 1.5)
    assert heavy["motor_lag_s"] == pytest.approx(0.0375)
    with pytest.raises(KeyError):
        mismatched(usual, "unlucky")
