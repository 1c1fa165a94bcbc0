"""A ground that is started while simulated drones hover under none takes them over where they are."""

from math import dist

from formation.messages import Phase, Verb
from sim.faults.fault import Family, Fault
from sim.proof.labs import scenario
from sim.world import World

KILLED_S = 2.45
"""After the formation began: shortly before a heartbeat, by which the new ground knows that there are drones."""


def fly_until(world: World, phase: Phase, within_s: float, ask: Verb | None = None) -> None:
    """Step until then, asking for the same at every look."""
    end_ns = world.now_ns + round(within_s * 1e9)
    while world.phase is not phase:
        assert world.now_ns < end_ns, world.phase
        looked_ns = world.now_ns // 100_000_000
        world.step()
        if ask is not None and world.now_ns // 100_000_000 != looked_ns:
            world.ask(ask)


def test_drones_that_hover_under_no_ground_are_taken_over_into_hold_and_fly_on() -> None:
    restart = Fault(family=Family.RESTART, core="ground", after_s=KILLED_S, for_s=0.1)
    world = World(scenario("hold").model_copy(update={"faults": (restart,)}), 1, lambda _topic, _message, _t_ns: None)
    fly_until(world, Phase.FORMATION, 12.0)
    fly_until(world, Phase.GROUND, 4.0)
    hovering = world.truths()
    fly_until(world, Phase.HOLD, 0.8, Verb.TAKE_CONTROL)
    end_ns = world.now_ns + 4_000_000_000
    while world.now_ns < end_ns:
        world.step()
        assert all(dist(truth.pos_lab_m, hovering[k].pos_lab_m) < 0.15 for k, truth in world.truths().items())
    world.ask(Verb.LAND)
    fly_until(world, Phase.LAND, 1.0)
    fly_until(world, Phase.GROUND, 12.0)
    assert not any(truth.armed for truth in world.truths().values())
