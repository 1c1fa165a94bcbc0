"""What the ground asks of each autopilot, against what the simulated ones are."""

import pytest

from drone_agent.autopilots import MODELS
from drone_agent.crazyflie.model import CRAZYFLIE_MODEL
from gcs.drones.autopilot_model import GROUND_MODELS, GroundModel
from wire.link_messages import Heartbeat, MavAutopilot


def test_agent_and_ground_build_on_the_same_tables() -> None:
    assert {model.table.autopilot: model.table for model in (*MODELS.values(), CRAZYFLIE_MODEL)} == {
        kind: model.table for kind, model in GROUND_MODELS.items()
    }


@pytest.mark.parametrize("model", GROUND_MODELS.values(), ids=lambda model: model.name)
def test_a_heartbeat_is_of_one_model_and_a_strangers_generic_one_of_none(model: GroundModel) -> None:
    table = model.table
    for mode, number in table.modes.items():
        beat = Heartbeat(table.autopilot, 2, 0, table.custom_mode(mode), 4)
        assert [each for each in GROUND_MODELS.values() if each.table.is_of(beat)] == [model]
        assert table.split(beat.custom_mode)[0] == number.main
    assert not any(table.is_of(Heartbeat(MavAutopilot.GENERIC, 2, 0, mode, 4)) for mode in (*range(16), 2**32 - 1))


@pytest.mark.parametrize("model", GROUND_MODELS.values(), ids=lambda model: model.name)
def test_a_rule_holds_of_what_it_sets_and_not_of_everything(model: GroundModel) -> None:
    for rule in model.rules:
        spec = model.table.parameters[rule.name]
        assert rule.holds(rule.set_to), rule.name
        assert spec.low <= rule.set_to <= spec.high
        assert not all(rule.holds(float(value)) for value in (*range(16), spec.low, spec.high, 0.5)), rule.name


def test_a_hover_thrust_is_measured_where_it_is_no_default_and_no_nonsense() -> None:
    model = GROUND_MODELS[MavAutopilot.PX4]
    assert [model.hover_measured(value) for value in (0.5, 0.45, 0.0, 1.0)] == [False, True, False, False]
