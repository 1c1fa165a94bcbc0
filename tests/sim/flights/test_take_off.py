"""A take-off ends at its height: it is led there, and does not shoot past it."""

import pytest

from sim import lockstep
from sim.scenario import load
from wire.logs.mcap_log import Entry

HEIGHT_M = 1.2


def truths(records: list[Entry]) -> list[float]:
    return [entry.message.pos_lab_m[2] for entry in records if entry.topic.name == "sim/truth"]


@pytest.mark.parametrize("profile", ["paper_40g", "px4_quad"])
def test_a_take_off_does_not_overshoot(profile: str) -> None:
    scenario = load("triangle_line")
    lab = scenario.lab
    lab = lab.model_copy(
        update={
            "leader": lab.leader.model_copy(update={"profile": profile}),
            "followers": tuple(follower.model_copy(update={"profile": profile}) for follower in lab.followers),
            "flight": lab.flight.model_copy(update={"altitude_m": HEIGHT_M}),
        }
    )
    flown, records = lockstep.run_in_memory(scenario.model_copy(update={"lab": lab}), 7)
    assert flown.outcome.result == "landed"
    assert max(truths(records)) < HEIGHT_M + 0.05
