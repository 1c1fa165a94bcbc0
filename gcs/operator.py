"""What an operator may ask, and the answers: requests become triggers, refusals say why, status is JSON."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from formation.config import LabConfig
from formation.guidance.shape import Shape
from formation.messages import Phase
from formation.safety import arming
from formation.safety.rules import Facts
from gcs.drones.drone import TAKE_OFF_S, Drone
from gcs.flight import Flight


@dataclass(frozen=True, slots=True)
class About:
    """What the ground says of itself: since its start, s; its epoch; what is wrong with its log; its counters.

    rejected: why the mocap gate rejects a body now, by body.
    """

    t_s: float
    epoch: int
    log_trouble: str
    counters: Mapping[str, int | float]
    rejected: Mapping[str, str]


def take_off_refusals(
    facts: Facts, flight: Flight, drones: Sequence[Drone], config: LabConfig, now_ns: int
) -> tuple[str, ...]:
    """Why the swarm may not leave the floor now; as for arming, and every drone must have armed, and stay so."""
    not_armed = () if flight.armed else ("not every drone has armed yet",)
    return arming.refusals(facts, config.limits) + not_armed + _too_late(drones, now_ns)


def _too_late(drones: Sequence[Drone], now_ns: int) -> tuple[str, ...]:
    """Who would disarm by itself before it has lifted off."""
    left_s = [drone.disarms_in_s(now_ns) for drone in drones]
    return tuple(
        f"{drone.link.name}: disarms itself in {left:.1f} s, a take-off needs {TAKE_OFF_S:g} s: land, and arm again"
        for drone, left in zip(drones, left_s, strict=True)
        if left is not None and left < TAKE_OFF_S
    )


def status_text(
    flight: Flight,
    drones: Sequence[Drone],
    facts: Facts,
    refusals: Sequence[str],
    about: About,
    now_ns: int,
) -> str:
    """The whole state for people and scripts: what `gcs status --json` prints."""
    return json.dumps(
        {
            "phase": flight.phase.name,
            "cause": flight.cause,
            "t_s": round(about.t_s, 3),
            "epoch": about.epoch,
            "log_trouble": about.log_trouble,
            "armed": flight.armed,
            "trajectory_started": flight.trajectory_start_ns is not None,
            "trajectory_done": flight.trajectory_done(now_ns),
            "shape": flight.shape.name,
            "drones": [
                _drone_status(drone, facts, now_ns) | {"rejected": about.rejected.get(drone.link.name)}
                for drone in drones
            ],
            "rejected": dict(about.rejected),
            "refusals": list(refusals),
            "counters": dict(about.counters),
        }
    )


def _drone_status(drone: Drone, facts: Facts, now_ns: int) -> dict[str, object]:
    link, i = drone.link, drone.index
    disarms_in_s = drone.disarms_in_s(now_ns)
    offset_ns = link.clock.offset_ns
    return {
        "sysid": link.sysid,
        "body": link.name,
        "autopilot": None if link.model is None else link.model.name,
        "armed": link.armed,
        "disarms_in_s": None if disarms_in_s is None else round(disarms_in_s, 1),
        "mode": link.mode,
        "goal": drone.goal.value,
        "piloted": drone.piloted,
        "landed": link.telemetry.landed.name,
        "pos_lab_m": [round(x, 4) for x in facts.pos_lab_m[i].tolist()] if math.isfinite(facts.age_s[i]) else None,
        "age_s": _number(float(facts.age_s[i]), 3),
        "heartbeat_age_s": _number(float(facts.heartbeat_age_s[i]), 2),
        "battery": _number(link.telemetry.battery, 3),
        "setpoint_age_s": _number(link.setpoint_age_s(now_ns), 4),
        "clock_offset_s": None if offset_ns is None else round(offset_ns * 1e-9, 6),
        "loss": round(link.sequence.loss, 4),
    }


def _number(value: float, digits: int) -> float | None:
    """JSON has neither NaN nor infinity: what is unknown, and the age of what never was, is null."""
    return round(value, digits) if math.isfinite(value) else None


def armed_text(flight: Flight, now_ns: int) -> str:
    """What is said when every drone is armed: for how long they will be."""
    first = flight.first_to_disarm(now_ns)
    if first is None:
        return "every drone is armed"
    return f"every drone is armed; take off within {max(first[1] - TAKE_OFF_S, 0.0):.1f} s ({first[0]} disarms itself)"


def done_text(phase: Phase, shape: Shape) -> str:
    """What is said of a request that was carried out at once."""
    return f"phase {phase.name}, shape {shape.name}"
