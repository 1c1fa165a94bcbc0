"""The constant that stamps leave out, found again where it was put in."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.identify.estimate import Estimate
from analysis.identify.latency import attitudes_of, late
from analysis.load import Flight, from_records
from sim import lockstep, scenario

TRUE_WITHIN_S = 1e-3
"""An attitude's stamp counts milliseconds."""


@pytest.fixture(scope="module")
def flown() -> Flight:
    """Three drones on a circle that tilts them, stamps exact."""
    plan = scenario.load("triangle_circle")
    trajectory = plan.lab.leader.trajectory.model_copy(update={"duration_s": 12.0, "period_s": 6.0})
    leader = plan.lab.leader.model_copy(update={"trajectory": trajectory})
    plan = plan.model_copy(update={"lab": plan.lab.model_copy(update={"leader": leader}), "formation_s": 12.0})
    _, records = lockstep.run_in_memory(plan, 5)
    return from_records(lockstep.metadata(plan, 5, "memory", 0), records)


def later(flight: Flight, by_s: float) -> Flight:
    """The same with every frame stamped later than it was exposed."""
    return replace(flight, poses=replace(flight.poses, t_s=flight.poses.t_s + by_s))


@pytest.mark.parametrize("by_s", [0.0, 0.006, -0.004])
def test_a_constant_error_of_the_stamps_is_found_of_every_drone(flown: Flight, by_s: float) -> None:
    flight = later(flown, by_s)
    own = attitudes_of(flight)
    for vehicle in flight.vehicles:
        assert vehicle.sysid is not None
        found = late(flight, vehicle, own[vehicle.sysid])
        assert isinstance(found, Estimate)
        assert found.value == pytest.approx(by_s, abs=TRUE_WITHIN_S)
        assert 0.0 < found.half_width < 0.002


def test_how_the_markers_lie_on_the_drone_is_no_delay(flown: Flight) -> None:
    tilted = np.array([0.9992, 0.03, -0.0265, 0.0])
    poses = flown.poses
    w, x, y, z = np.moveaxis(poses.q_lab_from_flu, -1, 0)
    a, b, c, d = tilted / np.linalg.norm(tilted)
    turned = np.stack(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ],
        axis=-1,
    )
    flight = replace(flown, poses=replace(poses, q_lab_from_flu=turned))
    vehicle = flight.vehicles[1]
    assert vehicle.sysid is not None
    found = late(flight, vehicle, attitudes_of(flight)[vehicle.sysid])
    assert isinstance(found, Estimate)
    assert found.value == pytest.approx(0.0, abs=TRUE_WITHIN_S)


def test_a_drone_that_says_nothing_of_itself_is_not_judged(flown: Flight) -> None:
    assert late(flown, flown.vehicles[1], None) == "the autopilot reported too few attitudes"
