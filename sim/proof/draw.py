"""A run of the campaign: its flight and its one or two faults, drawn by the campaign's seed and its number.

`GROUP` runs on end share one flight, so that it is flown once up to their onsets (sim.proof.group).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi
from types import MappingProxyType
from typing import get_args

import numpy as np

from formation.messages import Verb
from formation.vehicle.profile import profile
from sim.faults.fault import GROUND_RECEIVER, Core, Family, Fault, OnsetPhase, Site
from sim.proof.labs import DEFAULT_PROFILE, KINDS, scenario
from sim.scenario import Scenario

GROUP = 12
FOLLOWERS = (2, 2, 2, 2, 3, 3, 4, 5, 6, 8, 10)
MASS = THRUST = 0.05
FOR_EVER = 0.15
"""The share of losses that never end."""
PHASES: Mapping[OnsetPhase, tuple[float, float]] = MappingProxyType(
    {
        "GROUND": (0.05, 1.0), "ARMED": (0.05, 1.5), "TAKEOFF": (0.2, 2.5), "HOLD": (0.05, 0.3),
        "FORMATION": (0.5, 4.5), "LAND": (0.15, 3.0),
    }
)  # fmt: skip
"""Share of the onsets, and how many seconds after the phase's beginning they may lie."""
SOONEST_S = 0.03
"""No onset is drawn nearer to its phase's beginning, so that it is known before it comes."""


@dataclass(frozen=True, slots=True)
class Range:
    """A family's severities from low to high, in even steps of their logarithm, and lengths, s; for_s None: none."""

    low: float = 1.0
    high: float = 1.0
    for_s: tuple[float, float] | None = (0.02, 3.0)


RANGES: Mapping[Family, Range] = MappingProxyType(
    {
        Family.FREEZE: Range(),
        Family.JUMP: Range(0.3, 3.0),
        Family.ABSURD: Range(5.0, 1e9, (0.005, 0.3)),
        Family.NOT_A_NUMBER: Range(),
        Family.FLIP: Range(0.8, pi, (0.02, 1.0)),
        Family.YAW: Range(0.5, pi, (0.02, 2.0)),
        Family.SWAP: Range(),
        Family.LOST_BODY: Range(for_s=(0.05, 5.0)),
        Family.DRIFT: Range(0.05, 0.5, (0.5, 5.0)),
        Family.NOISE: Range(0.002, 0.03),
        Family.HIDDEN_LATENCY: Range(0.03, 0.4, (0.1, 10.0)),
        Family.STAMP_OFFSET: Range(0.01, 0.5, (0.1, 10.0)),
        Family.LOST_STREAM: Range(for_s=(0.05, 5.0)),
        Family.LATE_STREAM: Range(0.02, 0.5, (0.1, 10.0)),
        Family.SLOW_STREAM: Range(0.3, 0.97, (0.1, 10.0)),
        Family.DROP: Range(0.05, 1.0, (0.1, 10.0)),
        Family.DELAY: Range(0.02, 1.0, (0.1, 10.0)),
        Family.GROWING_DELAY: Range(0.02, 0.5, (1.0, 10.0)),
        Family.JITTER: Range(0.005, 0.1, (0.1, 10.0)),
        Family.REORDER: Range(0.05, 0.5, (0.1, 10.0)),
        Family.DUPLICATE: Range(0.05, 1.0, (0.1, 10.0)),
        Family.CORRUPT: Range(0.05, 1.0, (0.1, 10.0)),
        Family.REPLAY: Range(0.05, 2.5, (0.1, 10.0)),
        Family.KILL: Range(for_s=None),
        Family.STALL: Range(for_s=(0.02, 5.0)),
        Family.RESTART: Range(for_s=(0.1, 4.0)),
        Family.TWIN: Range(for_s=(1.0, 10.0)),
        Family.DEAD_MOTOR: Range(0.01, 0.3, None),
        Family.WEAK_MOTORS: Range(0.4, 1.0, (0.5, 5.0)),
        Family.MASS: Range(0.9, 1.15, (0.5, 5.0)),
        Family.BATTERY: Range(0.01, 0.3, None),
        Family.REQUEST: Range(for_s=None),
        Family.PILOT: Range(for_s=(0.5, 8.0)),
        Family.LOG_TROUBLE: Range(for_s=(0.5, 10.0)),
    }
)
ASKED = (Verb.ARM, Verb.TAKEOFF, Verb.START, Verb.HOLD, Verb.LAND, Verb.STOP, Verb.SHAPE, Verb.TAKE_CONTROL)
SHAPES = ("line", "v", "circle", "configured")
REQUESTED = (None, Verb.ARM, Verb.TAKE_CONTROL, Verb.LAND, Verb.STOP)
"""The requests to a restarted or second ground."""

FAMILIES_DRAWN: tuple[Family, ...] = tuple(RANGES)


@dataclass(frozen=True, slots=True)
class Draw:
    """The draw of a campaign: its seed, the families of which every run's first fault is one, and the vehicle."""

    seed: int
    first_of: tuple[Family, ...] = FAMILIES_DRAWN
    profile: str = DEFAULT_PROFILE

    def again(self, number: int) -> str:
        """The command that flies this run again."""
        first_of = () if self.first_of == FAMILIES_DRAWN else self.first_of
        chosen = [f" --family {family}" for family in first_of]
        if self.profile != DEFAULT_PROFILE:
            chosen.append(f" --profile {self.profile}")
        return f"gcs-sim campaign --replay {self.seed}:{number}{''.join(chosen)}"


def flight_of(draw: Draw, group: int) -> Scenario:
    """The flight of a group, without faults."""
    rng = np.random.default_rng([draw.seed, 12, group])
    kind = KINDS[int(rng.integers(len(KINDS)))]
    followers = FOLLOWERS[int(rng.integers(len(FOLLOWERS)))]
    plain = scenario(kind, followers, profile=draw.profile)
    vehicles = []
    believed = profile(plain.lab.leader.profile)
    makes = ("px4", "ardupilot") if rng.random() < 0.2 else (("px4", "ardupilot")[int(rng.integers(2))],)
    for vehicle in plain.vehicles:
        true = {
            "mass_kg": believed.mass_kg * rng.uniform(1.0 - MASS, 1.0 + MASS),
            "thrust_max_n": believed.thrust_max_n * rng.uniform(1.0 - THRUST, 1.0 + THRUST),
        }
        make = makes[int(rng.integers(len(makes)))]
        vehicles.append(vehicle.model_copy(update={"vehicle": true, "autopilot": make}))
    return plain.model_copy(
        update={"seed": int(rng.integers(2**31)), "name": f"campaign_{draw.seed}_{group}", "vehicles": tuple(vehicles)}
    )


def faults_of(draw: Draw, number: int, flight: Scenario) -> tuple[Fault, ...]:
    """The one or two faults of a run."""
    rng = np.random.default_rng([draw.seed, 11, number])
    families = (draw.first_of, FAMILIES_DRAWN)[: int(rng.integers(1, 3))]
    return tuple(fault(of[int(rng.integers(len(of)))], flight, rng) for of in families)


def run_of(draw: Draw, number: int) -> Scenario:
    """A run whole: its flight with its faults."""
    flight = flight_of(draw, number // GROUP)
    name = f"campaign_{draw.seed}_{number}"
    return flight.model_copy(update={"name": name, "faults": faults_of(draw, number, flight)})


def fault(family: Family, flight: Scenario, rng: np.random.Generator) -> Fault:
    """One of that family."""
    scale = RANGES[family]
    phases = tuple(PHASES)
    phase = phases[int(rng.choice(len(phases), p=[share for share, _ in PHASES.values()]))]
    values: dict[str, object] = {
        "family": family,
        "phase": phase,
        "after_s": round(float(rng.uniform(SOONEST_S, PHASES[phase][1])), 3),
        "severity": float(f"{np.exp(rng.uniform(np.log(scale.low), np.log(scale.high))):.3g}"),
    }
    if scale.for_s is not None:
        low, high = np.log(scale.for_s)
        values["for_s"] = max(round(float(np.exp(rng.uniform(low, high))), 3), 0.005)
    values |= _VICTIMS.get(family, _VICTIM_AT[Fault.model_construct(family=family).site])(family, flight, rng)
    return Fault.model_validate(values)


_Victim = Callable[[Family, Scenario, np.random.Generator], dict[str, object]]


def _bodies(flight: Scenario) -> list[str]:
    return [v.body for v in flight.lab.vehicles]


def _drones(flight: Scenario) -> list[str]:
    return [v.body for v in flight.lab.vehicles if v.sysid is not None]


def _one(of: Sequence[str], rng: np.random.Generator) -> str:
    return of[int(rng.integers(len(of)))]


def _body(_family: Family, flight: Scenario, rng: np.random.Generator) -> dict[str, object]:
    return {"body": _one(_bodies(flight), rng)}


def _drone(_family: Family, flight: Scenario, rng: np.random.Generator) -> dict[str, object]:
    return {"body": _one(_drones(flight), rng), "motor": int(rng.integers(4))}


def _every_body(_family: Family, _flight: Scenario, _rng: np.random.Generator) -> dict[str, object]:
    return {}


def _stamps(_family: Family, _flight: Scenario, rng: np.random.Generator) -> dict[str, object]:
    return {"severity": float(rng.uniform(-0.5, 0.5))}


def _two(_family: Family, flight: Scenario, rng: np.random.Generator) -> dict[str, object]:
    bodies = _bodies(flight)
    one, other = rng.permutation(len(bodies))[:2].tolist()
    return {"body": bodies[one], "other": bodies[other]}


def _receiver(family: Family, flight: Scenario, rng: np.random.Generator) -> dict[str, object]:
    values: dict[str, object] = {"receiver": (None, GROUND_RECEIVER, _one(_drones(flight), rng))[int(rng.integers(3))]}
    if family is Family.LOST_STREAM and rng.random() < FOR_EVER:
        values["for_s"] = None
    return values


def _link_direction(family: Family, flight: Scenario, rng: np.random.Generator) -> dict[str, object]:
    values: dict[str, object] = {"direction": _one(("down", "up", "both"), rng)}
    if rng.random() < 0.5:
        values["body"] = _one(_drones(flight), rng)
    if family is Family.DROP and rng.random() < FOR_EVER:
        values["for_s"] = None
    return values


def _core(family: Family, flight: Scenario, rng: np.random.Generator) -> dict[str, object]:
    core = _one(get_args(Core), rng)
    values: dict[str, object] = {"core": core}
    if core == "agent":
        values["body"] = _one(_drones(flight), rng)
    elif core == "ground" and family in (Family.RESTART, Family.TWIN):
        values["verb"] = REQUESTED[int(rng.integers(len(REQUESTED)))]
    return values


def _asked(_family: Family, _flight: Scenario, rng: np.random.Generator) -> dict[str, object]:
    verb = ASKED[int(rng.integers(len(ASKED)))]
    return {"verb": verb, "argument": _one(SHAPES, rng) if verb is Verb.SHAPE else ""}


_VICTIM_AT: Mapping[Site, _Victim] = MappingProxyType(
    {
        Site.CAMERAS: _body, Site.BUS: _receiver, Site.LINK: _link_direction, Site.CORE: _core, Site.VEHICLE: _drone,
        Site.OPERATOR: _drone, Site.HOST: _every_body,
    }
)  # fmt: skip
_VICTIMS: Mapping[Family, _Victim] = MappingProxyType(
    {
        Family.SWAP: _two, Family.HIDDEN_LATENCY: _every_body, Family.STAMP_OFFSET: _stamps, Family.REQUEST: _asked,
    }
)  # fmt: skip
