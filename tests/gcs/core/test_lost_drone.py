"""A drone that falls silent in flight: it never counts as landed, and its alarm stays until it is heard again."""

from formation.messages import Cause, EventCode, Phase
from formation.safety.phases import Trigger
from tests.gcs.fakes import FakeLab, flying, triangle


def test_a_silent_drone_is_lost_with_an_alarm_until_it_responds_and_is_landed():
    """`left` is dead to the ground from the formation on, and hangs in the air."""
    lab = flying()
    drone, alarm = lab.drones[2], "left: nothing heard for 3 s"
    rule = "rule-silent"
    drone.sends_nothing = drone.receives_nothing = True
    lab.run_until(Phase.LAND)
    lab.run_until(Phase.GROUND)
    assert lab.state.cause.startswith("LAND ended: left unheard for ")
    assert "last seen in the air at x " in lab.state.cause
    assert lab.causes[-1] is Cause.NOT_LANDED
    assert (EventCode.NOT_LANDED, "") in lab.reported
    assert lab.state.not_landed == ("left",)
    lab.run(10.0)
    assert (f"over {rule}", "left") not in lab.reported
    assert alarm in lab.state.open_alarms
    drone.sends_nothing = drone.receives_nothing = False
    lab.run(3.0)
    assert (f"over {rule}", "left") in lab.reported
    assert (lab.state.open_alarms, lab.state.not_landed, drone.armed) == ((), (), False)


def test_a_drone_that_falls_silent_after_it_has_landed_is_not_lost():
    lab = FakeLab(triangle())
    lab.fly()
    lab.core._flight.pull(Trigger.LAND, Cause.OPERATOR, "test", lab.now_ns)
    lab.run_until(Phase.GROUND)
    lab.drones[2].sends_nothing = True
    lab.run(10.0)
    assert lab.state.not_landed == ()
    assert lab.state.cause_code is Cause.LANDED
