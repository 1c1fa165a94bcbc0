"""A drone that falls silent in flight: it never counts as landed, and its alarm stays until it is heard again."""

import json

from formation.messages import Phase
from tests.gcs.fakes import FakeLab, triangle


def _silent_in_flight() -> FakeLab:
    """`left` is dead to the ground from the formation on, and hangs in the air; the landing is over."""
    lab = FakeLab(triangle())
    lab.fly()
    lab.run(1.0)
    lab.drones[2].sends_nothing = lab.drones[2].receives_nothing = True
    lab.run_until(Phase.LAND)
    lab.run_until(Phase.GROUND)
    return lab


def _state(lab: FakeLab) -> dict:
    return json.loads(lab.core.status(lab.now_ns))


def test_a_silent_drone_does_not_count_as_landed():
    lab = _silent_in_flight()
    state = _state(lab)
    assert state["cause"].startswith("LAND ended: left unheard for ")
    assert "last seen in the air at x " in state["cause"]
    assert state["not_landed"] == ["left"]
    assert not any("every drone has landed" in text for text in lab.events)
    assert state["cause"] in lab.events


def test_its_alarm_is_open_until_it_responds_again():
    lab = _silent_in_flight()
    lab.run(10.0)
    assert "over: left: nothing heard for 3 s" not in lab.events
    assert "left: nothing heard for 3 s" in _state(lab)["open_alarms"]
    lab.drones[2].sends_nothing = lab.drones[2].receives_nothing = False
    lab.run(2.0)
    assert "over: left: nothing heard for 3 s" in lab.events
    assert _state(lab)["open_alarms"] == []


def test_a_lost_drone_that_responds_again_is_landed_and_lost_no_more():
    lab = _silent_in_flight()
    lab.drones[2].sends_nothing = lab.drones[2].receives_nothing = False
    lab.run(3.0)
    assert _state(lab)["not_landed"] == []
    assert not lab.drones[2].armed


def test_a_drone_that_falls_silent_after_it_has_landed_is_not_lost():
    lab = FakeLab(triangle())
    lab.fly()
    lab.core._flight.pull("land", "test", lab.now_ns)
    lab.run_until(Phase.GROUND)
    lab.drones[2].sends_nothing = True
    lab.run(10.0)
    assert _state(lab)["not_landed"] == []
    assert _state(lab)["cause"] == "every drone has landed and is disarmed"
