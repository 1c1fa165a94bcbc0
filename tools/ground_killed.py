"""Kills the ground at every tick of a flight at 1.5 m: how long until every drone has landed and disarmed.

    python -m tools.ground_killed --autopilot ardupilot --every 1

The flight is flown once; each landing is a process forked off it. Prints one line of JSON; exit code 1 where a drone
did not disarm, took longer than 5 s and its make's own disarm delay, or came down faster than 0.4 m/s.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from typing import Literal

import numpy as np

from drone_agent.autopilots import MODELS
from drone_agent.autopilots.parameters import Parameters
from formation.messages import Phase
from sim.scenario import Scenario, TrueVehicle, load
from sim.world import T0_NS, World

WITHIN_S, IMPACT_M_S = 5.0, 0.4
TICK_NS = 10_000_000
_PATIENCE_NS = 20_000_000_000


def scenario(autopilot: Literal["px4", "ardupilot"], *, height_m: float = 1.5) -> Scenario:
    """The paper's line at `height_m`, its three drones of one make."""
    line = load("triangle_line")
    flight = line.lab.flight.model_copy(update={"altitude_m": height_m})
    vehicles = tuple(TrueVehicle(sysid=k, autopilot=autopilot) for k in (1, 2, 3))
    return line.model_copy(update={"lab": line.lab.model_copy(update={"flight": flight}), "vehicles": vehicles})


def disarm_delay_s(autopilot: str) -> float:
    """What the make itself waits for, landed, before it disarms."""
    model = MODELS[autopilot]
    return model.timing(Parameters(model.table, dict(model.table.indoor))).disarm_landing_s


def landing(world: World) -> dict[str, float]:
    """Kill the ground now: seconds until all are disarmed, the fastest touch-down, the farthest drift."""
    world.kill_ground()
    killed_ns, before = world.now_ns, world.truths()
    autopilots = [node.autopilot for node in world.nodes.values()]
    impact_m_s, last = 0.0, before
    while any(each.autopilot.armed for each in autopilots) and world.now_ns < killed_ns + _PATIENCE_NS:
        world.step()
        now = world.truths()
        touched = [k for k, truth in now.items() if truth.on_ground and not last[k].on_ground]
        impact_m_s = max([impact_m_s, *(-float(last[k].vel_lab_m_s[2]) for k in touched)])
        last = now
    return {
        "t_s": round((killed_ns - T0_NS) * 1e-9, 3),
        "height_m": max(float(truth.pos_lab_m[2]) for truth in before.values()),
        "seconds": (world.now_ns - killed_ns) * 1e-9,
        "impact_m_s": impact_m_s,
        "drift_m": max(float(np.linalg.norm((last[k].pos_lab_m - before[k].pos_lab_m)[:2])) for k in before),
        "armed": float(any(each.autopilot.armed for each in autopilots)),
    }


def forked(world: World) -> dict[str, float]:
    """`landing` in a process of its own; the flight goes on as if it had not been."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        os.write(writer, json.dumps(landing(world)).encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as told:
        text = told.read()
    os.waitpid(child, 0)
    return dict(json.loads(text))


def landings(world: World, every: int) -> Iterator[dict[str, float]]:
    """One of every `every` ticks, from arming to the end of the flight."""
    ticks, next_ns = 0, T0_NS
    while world.operator.outcome is None:
        world.step()
        if world.now_ns < next_ns or world.operator.phase is Phase.GROUND:
            continue
        next_ns = world.now_ns + TICK_NS
        if ticks % every == 0:
            yield forked(world)
        ticks += 1


def main() -> int:
    """The program."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--autopilot", choices=tuple(MODELS), default="px4")
    parser.add_argument("--every", type=int, default=1)
    told = parser.parse_args()
    world = World(scenario(told.autopilot), 7, lambda _topic, _message, _t_ns: None)
    allowed_s = WITHIN_S + disarm_delay_s(told.autopilot)
    runs = list(landings(world, told.every))
    failed = [r for r in runs if r["armed"] or r["seconds"] > allowed_s or r["impact_m_s"] > IMPACT_M_S]
    worst = {key: max(r[key] for r in runs) for key in ("height_m", "seconds", "impact_m_s", "drift_m")}
    print(json.dumps({"runs": len(runs), "allowed_s": allowed_s, **worst, "failed": failed}))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
