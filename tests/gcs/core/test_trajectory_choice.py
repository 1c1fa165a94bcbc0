"""The leader's trajectory, chosen by the operator: GcsCore with fake drones, from the words to its way."""

from typing import Any

import pytest

from formation.config import LabConfig
from formation.messages import Verb
from tests.gcs.fakes import FakeLab, accepted, refusal, triangle

WAYS: dict[str, Any] = {
    "out": {"kind": "line", "length_m": 0.8, "duration_s": 3.0},
    "eight": {"kind": "figure8", "length_m": 0.8, "period_s": 6.0},
    "far": {"kind": "line", "length_m": 9.0, "duration_s": 30.0},
    "fast": {"kind": "circle", "radius_m": 0.8, "period_s": 1.2},
}


def lab(**leader: Any) -> LabConfig:
    stay = {"body": "lead", "sysid": 1, "trajectory": {"kind": "hold", "duration_s": 2.0}, "trajectories": WAYS}
    return triangle(leader=stay | leader)


@pytest.fixture(scope="module")
def standing() -> FakeLab:
    standing = FakeLab(lab())
    standing.run(2.0)
    return standing


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("loop", "no trajectory 'loop'; known: configured, out, eight, far, fast"),
        ("far", "beyond limits.fence.high_m x"),
        ("fast", "lead would fly at 4.19 m/s, limits.speed_m_s is 3"),
    ],
)
def test_what_cannot_be_flown_is_rejected_in_words(standing: FakeLab, name: str, why: str) -> None:
    assert why in refusal(standing, Verb.TRAJECTORY, name)
    assert standing.state.trajectory == "configured"


def test_a_trajectory_that_fits_from_the_origin_is_rejected_where_the_fence_is_too_near() -> None:
    """Lines begin where the leader is."""
    fence = {"fence": {"low_m": (-1.5, -1.5, -0.1), "high_m": (1.0, 1.5, 2.0)}}
    config = lab(trajectory={"kind": "hold", "duration_s": 1.0}, trajectories={"out": WAYS["out"]})
    flying = FakeLab(LabConfig.model_validate(config.model_dump() | {"limits": fence}))
    flying.run(1.0)
    accepted(flying, Verb.TRAJECTORY, "out")
    for drone in flying.drones.values():
        drone.pos[0] += 0.3
    flying.run(1.0)
    assert "lead: it would be outside the fence" in refusal(flying, Verb.TRAJECTORY, "out")
    accepted(flying, Verb.TRAJECTORY, "configured")


def test_a_leader_that_is_only_observed_has_none_to_choose() -> None:
    config = triangle(leader={"body": "lead", "trajectories": {"out": WAYS["out"]}})
    flying = FakeLab(config)
    flying.run(1.0)
    assert refusal(flying, Verb.TRAJECTORY, "out") == "lead: it is only observed, and flies what it flies"


def test_the_one_that_was_chosen_is_said_with_its_numbers_and_none_is_chosen_in_formation() -> None:
    """That it is flown, and replays: tests.gcs.test_replay."""
    flying = FakeLab(lab())
    flying.run(2.0)
    assert accepted(flying, Verb.TRAJECTORY, "out") == "phase GROUND, shape configured, trajectory out"
    assert "trajectory out: line, 0.80 m in 3.0 s, up to 0.50 m/s and 0.51 m/s^2" in flying.events
    flying.fly()
    assert refusal(flying, Verb.TRAJECTORY, "eight") == (
        "trajectory is for GROUND, ARMED, TAKEOFF, HOLD, this is FORMATION: `gcs hold` leads to HOLD, `gcs land` down"
    )
