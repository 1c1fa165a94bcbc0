"""What the ground does on a fault, played by its own rules: which acts after how long, and what follows. Pure.

A swarm of three with nothing wrong, and one fault that begins at 0 and stays: formation.safety judges it 100 times a
second as in flight, and the phase follows. Drones that come down are on the floor after LANDS_S.
"""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from formation.config import LimitsConfig
from formation.messages import Phase
from formation.safety import rules
from formation.safety.phases import AIRBORNE, TABLE, Trigger, advance
from formation.safety.rules import Facts
from formation.safety.rules_table import Own

NAMES = ("leader", "left", "right")
STEP_NS, LASTS_S, LANDS_S = 10_000_000, 12.0, 6.0
PHASES = tuple(phase for phase in Phase if phase in AIRBORNE | {Phase.ARMED})
Changed = dict[str, Any]
Acts = dict[str, list[dict[str, Any]]]
"""By fault."""


def _set(name: str, value: float | bool) -> Callable[[Facts, int, float], Changed]:
    def change(facts: Facts, who: int, _s: float) -> Changed:
        array = getattr(facts, name).copy()
        array[who] = value
        return {name: array}

    return change


def _growing(name: str) -> Callable[[Facts, int, float], Changed]:
    """A time that runs from the fault on."""
    return lambda facts, who, t_s: _set(name, t_s)(facts, who, t_s)


def _flies_off(facts: Facts, who: int, t_s: float) -> Changed:
    """It flies away with 1 m/s from the wall of the fence, 2 m from the middle; mocap and autopilot agree."""
    pos_lab_m = facts.pos_lab_m.copy()
    pos_lab_m[who] = [2.0 + t_s, 0.0, 0.5]
    return {"pos_lab_m": pos_lab_m, "own_pos_lab_m": pos_lab_m}


def _comes_near(share: float) -> Callable[[Facts, int, float], Changed]:
    """It is so near to another one, in minimum separations."""

    def change(facts: Facts, who: int, _s: float) -> Changed:
        pos_lab_m = facts.pos_lab_m.copy()
        other = 1 if who != 1 else 2
        pos_lab_m[who] = pos_lab_m[other] + np.array([share * SEPARATION_M, 0.0, 0.0])
        return {"pos_lab_m": pos_lab_m}

    return change


def _tips_over(facts: Facts, who: int, t_s: float) -> Changed:
    return _set("tilt_rad", 1.5)(facts, who, t_s) | _set("own_tilt_rad", 1.5)(facts, who, t_s)


SEPARATION_M = 0.2
FAULTS: Mapping[str, Callable[[Facts, int, float], Changed]] = MappingProxyType(
    {
        "the cameras do not see it any more": _growing("age_s"),
        "it flies off at 1 m/s, beyond the fence": _flies_off,
        "it is at 0.9 of the minimum separation": _comes_near(0.9),
        "it is at 0.4 of the minimum separation": _comes_near(0.4),
        "it is 0.4 m away from where it is led": _set("error_m", 0.4),
        "it is 1.2 m away from where it is led": _set("error_m", 1.2),
        "it turns over; cameras and autopilot agree": _tips_over,
        "its mocap tilt alone is 86 degrees": _set("tilt_rad", 1.5),
        "nothing is heard of it any more": _growing("silent_s"),
        "its telemetry is 150 ms late": _set("link_behind_s", 0.15),
        "its telemetry is 400 ms late": _set("link_behind_s", 0.4),
        "its setpoints are 80 ms old": _set("setpoint_age_s", 0.08),
        "its setpoints are 150 ms old": _set("setpoint_age_s", 0.15),
        "its autopilot leaves off-board mode": _set("offboard", False),
        "it disarms": _set("armed", False),
        "its battery is at 15 %": _set("battery", 0.15),
        "its battery is at 5 %": _set("battery", 0.05),
        "its attitude is not the mocap's": _set("attitude_innovation_rad", 1.0),
        "three tenths of all frames are late": lambda _f, _w, _s: {"late_share": 0.3},
        "eight tenths of all frames are late": lambda _f, _w, _s: {"late_share": 0.8},
        "its system id is used twice": _set("duplicate", True),
    }
)
"""By what is wrong with one drone; some are everybody's."""


@dataclass(frozen=True, slots=True)
class Act:
    """Something that follows from a fault. after_s: since it began; phase: of the swarm from then on.

    rule: by its name, empty where the drones are on the floor; own: what happens to that drone.
    """

    after_s: float
    rule: str
    text: str
    phase: Phase
    own: Own = Own.NOTHING


def play(phase: Phase, fault: str, who: int, limits: LimitsConfig) -> Iterator[Act]:
    """What follows, in order; who: the index of the faulty drone, 0 the leader. KeyError for a fault that is none."""
    limits = limits.model_copy(update={"min_separation_m": SEPARATION_M})
    state, healthy, wrong = rules.start(len(NAMES)), _healthy(), FAULTS[fault]
    landing_ns: int | None = None
    for now_ns in range(0, round(LASTS_S * 1e9), STEP_NS):
        facts = healthy._replace(**wrong(healthy, who, now_ns * 1e-9))
        state, verdict = rules.assess(state, facts, phase, limits, now_ns)
        after = phase if verdict.trigger is None else advance(phase, verdict.trigger) or phase
        if after is Phase.LAND and phase is not Phase.LAND:
            landing_ns = now_ns
        phase = after
        for change in verdict.changes:
            if change.began:
                yield Act(now_ns * 1e-9, change.rule.name, change.text, phase, change.rule.own)
        if landing_ns is not None and now_ns - landing_ns >= LANDS_S * 1e9:
            yield Act(now_ns * 1e-9, "", "on the floor, disarmed", TABLE[phase, Trigger.DISARMED])
            return


def _healthy() -> Facts:
    n = len(NAMES)
    zeros, nan = np.zeros(n), np.full(n, np.nan)
    no, yes = np.zeros(n, np.bool_), np.ones(n, np.bool_)
    pos_lab_m = np.array([[0.0, 0.0, 0.5], [-0.8, 0.8, 0.5], [-0.8, -0.8, 0.5]])
    return Facts(
        names=NAMES, commanded=yes, excluded=no, landing=no, pos_lab_m=pos_lab_m, speed_m_s=zeros, tilt_rad=zeros,
        age_s=zeros, error_m=zeros, model_mismatch=zeros, own_pos_lab_m=pos_lab_m, own_tilt_rad=zeros,
        attitude_innovation_rad=zeros, heartbeat_age_s=zeros, silent_s=zeros, link_behind_s=nan, setpoint_age_s=nan,
        armed=yes, offboard=yes, battery=np.ones(n), duplicate=no, late_share=0.0,
    )  # fmt: skip


def acts(phase: Phase, who: int, limits: LimitsConfig) -> Acts:
    """What follows of every fault of that body in that phase."""
    return {
        fault: [asdict(act) | {"phase": act.phase.name} for act in play(phase, fault, who, limits)] for fault in FAULTS
    }


def lines(by_fault: Acts) -> Iterator[str]:
    """The same for people, a line an act."""
    for fault, follows in by_fault.items():
        yield fault
        for act in follows:
            own = "" if act["own"] == Own.NOTHING else f"; that drone: {act['own']}"
            yield f"  {act['after_s']:5.2f} s  {act['phase']:9}  {act['text']}{own}"
        if not follows:
            yield "           nothing follows"


def html(limits: LimitsConfig) -> str:
    """A page on which phase, fault and body are chosen."""
    template = (Path(__file__).parent / "played.html").read_text(encoding="utf-8")
    found = {phase.name: {NAMES[who]: acts(phase, who, limits) for who in (1, 0)} for phase in PHASES}
    return template.replace("{}", json.dumps(found), 1)
