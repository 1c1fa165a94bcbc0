"""The leader's trajectory, chosen by the operator: GcsCore with fake drones, from the words to its way."""

from typing import Any

import numpy as np
import pytest

from formation.config import LabConfig
from formation.messages import Event, OperatorReply, Phase, Verb
from tests.gcs.fakes import FakeLab, triangle

WAYS: dict[str, Any] = {
    "out": {"kind": "line", "length_m": 0.8, "duration_s": 3.0},
    "eight": {"kind": "figure8", "length_m": 0.8, "period_s": 6.0},
    "far": {"kind": "line", "length_m": 9.0, "duration_s": 30.0},
    "fast": {"kind": "circle", "radius_m": 0.8, "period_s": 1.2},
    "hard": {"kind": "circle", "radius_m": 0.3, "period_s": 1.2},
    "dizzy": {"kind": "hold", "yaw_rate_rad_s": 30.0},
}


def lab(**leader: Any) -> LabConfig:
    stay = {"body": "lead", "sysid": 1, "trajectory": {"kind": "hold", "duration_s": 2.0}, "trajectories": WAYS}
    return triangle(leader=stay | leader)


def ask(flying: FakeLab, name: str) -> OperatorReply:
    reply = flying.reply(flying.ask(Verb.TRAJECTORY, name))
    assert reply is not None
    return reply


@pytest.fixture(scope="module")
def standing() -> FakeLab:
    standing = FakeLab(lab())
    standing.run(2.0)
    return standing


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("loop", "no trajectory 'loop'; known: configured, out, eight, far, fast, hard, dizzy"),
        ("far", "beyond limits.fence.high_m x"),
        ("fast", "lead would fly at 4.19 m/s, limits.speed_m_s is 3"),
        ("hard", "of what paper_40g reaches under limits.tilt_rad = 0.6"),
        ("dizzy", "would turn at 30.0 rad/s"),
    ],
)
def test_what_cannot_be_flown_is_rejected_in_words(standing: FakeLab, name: str, why: str) -> None:
    reply = ask(standing, name)
    assert not reply.accepted
    assert why in reply.text
    assert standing.core.state(standing.now_ns)["trajectory"] == "configured"


def test_the_one_that_was_chosen_is_flown_and_another_one_after_it() -> None:
    flying = FakeLab(lab())
    flying.run(2.0)
    assert ask(flying, "out").text == "phase GROUND, shape configured, trajectory out"
    status = [event.text for name, event in flying.records if name == "event" and isinstance(event, Event)]
    assert "trajectory out: line, 0.80 m in 3.0 s, up to 0.50 m/s and 0.51 m/s^2" in status
    flying.fly()
    assert ask(flying, "eight").text == "trajectory is for GROUND, ARMED, TAKEOFF, HOLD, this is FORMATION"
    before = flying.drones[1].pos.copy()
    while not flying.core.state(flying.now_ns)["trajectory_done"]:
        flying.run(0.1)
    flying.run(1.0)
    np.testing.assert_allclose((flying.drones[1].pos - before)[:2], [0.8, 0.0], atol=0.02)
    flying.command(Verb.HOLD, Phase.HOLD)
    flying.run(1.0)
    assert ask(flying, "configured").accepted
    assert ask(flying, "eight").accepted
    flying.command(Verb.START, Phase.FORMATION)
    across = []
    while not flying.core.state(flying.now_ns)["trajectory_done"]:
        flying.run(0.1)
        across.append(flying.drones[1].pos[:2].copy())
    size = np.ptp(np.array(across), axis=0)
    assert size[1] == pytest.approx(0.4, abs=0.03)  # half as wide as long, about the lab's origin
    assert size[0] >= 1.18  # from 0.8 to -0.4


def test_a_trajectory_that_fits_from_the_origin_is_rejected_where_the_fence_is_too_near() -> None:
    """Lines begin where the leader is: out, and once more, is 1.6 m; with the fence at 1 m only the first fits."""
    fence = {"fence": {"low_m": (-1.5, -1.5, -0.1), "high_m": (1.0, 1.5, 2.0)}}
    config = lab(trajectory={"kind": "hold", "duration_s": 1.0}, trajectories={"out": WAYS["out"]})
    flying = FakeLab(LabConfig.model_validate(config.model_dump() | {"limits": fence}))
    flying.run(2.0)
    assert ask(flying, "out").accepted
    flying.fly()
    while not flying.core.state(flying.now_ns)["trajectory_done"]:
        flying.run(0.1)
    flying.command(Verb.HOLD, Phase.HOLD)
    flying.run(1.0)
    assert "lead: it would be outside the fence" in ask(flying, "out").text
    assert ask(flying, "configured").accepted


def test_a_leader_that_is_only_observed_has_none_to_choose() -> None:
    config = triangle(leader={"body": "lead", "trajectories": {"out": WAYS["out"]}})
    flying = FakeLab(config)
    flying.run(1.0)
    assert ask(flying, "out").text == "lead: it is only observed, and flies what it flies"
