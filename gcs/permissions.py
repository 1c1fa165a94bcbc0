"""May I? All that must hold before the ground does what an operator asks, in one table: `CONDITIONS`.

Whether a shape, its transition or a trajectory fits into the fence, and whom a request names, is judged when it is
asked for, by gcs.formation_change.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import permutations
from math import isfinite
from types import MappingProxyType

import numpy as np

from formation.config import PERSONAL_SPACE, LabConfig
from formation.messages import HostReport, Phase, Verb
from formation.reasons import LAND_AND_INCLUDE, Reason, Reject
from formation.safety.phases import PHASES_FOR, meant
from formation.safety.rules import Facts, nearest, outside_box
from formation.safety.rules_table import HEARTBEAT_S, UNSEEN_S
from gcs.drones.autopilot_model import HOVER_WITHIN, ParameterRule
from gcs.drones.drone import TAKE_OFF_S, Drone
from gcs.drones.land_detector import AIRBORNE_STATES
from gcs.drones.link_state import DroneLink
from gcs.flight import Flight
from gcs.safety import ARM_IN_AIR, ARM_OTHER_GROUND

STILL_M_S = 0.3
LEVEL_RAD = 0.35


@dataclass(frozen=True, slots=True)
class Situation:
    """The facts by which a request is judged. without: monitors that are switched off.

    excluded: the bodies that take no part after the request.
    """

    config: LabConfig
    drones: tuple[Drone, ...]
    flight: Flight
    host: HostReport
    without: frozenset[str]
    facts: Facts
    now_ns: int
    excluded: Collection[str] = ()

    @property
    def participants(self) -> tuple[Drone, ...]:
        """Drones that take part."""
        return tuple(d for d in self.drones if d.link.name not in self.excluded)

    @property
    def flying(self) -> tuple[Drone, ...]:
        """Drones that are armed, or report that they are in the air."""
        return tuple(d for d in self.drones if d.link.armed or d.link.telemetry.landed in AIRBORNE_STATES)

    @property
    def unheard(self) -> tuple[Drone, ...]:
        """Drones of this flight whose last heartbeat is too old."""
        return tuple(d for d in self.participants if d.link.ages(self.now_ns).heartbeat_s > HEARTBEAT_S)


Condition = Callable[[Situation], Iterable[Reject]]
"""Named by what must hold; returns every reason for which it does not."""


def reject_reasons(verb: Verb, situation: Situation) -> tuple[Reject, ...]:
    """Every reason against the request now; where it is for other phases, this one alone."""
    unmet = (reject for condition in CONDITIONS.get(verb, ()) for reject in condition(situation))
    return out_of_turn(verb, situation.flight.phase) or tuple(unmet)


def out_of_turn(verb: Verb, phase: Phase) -> tuple[Reject, ...]:
    """Why the request is not for this phase; empty where it is."""
    if phase in PHASES_FOR[verb]:
        return ()
    names = ", ".join(each.name for each in PHASES_FOR[verb])
    return (Reason.OUT_OF_TURN.of(verb.command_name, names, phase.name, meant(verb, phase)),)


def allowed(situation: Situation) -> dict[str, tuple[Reject, ...]]:
    """By verb, in the order of a flight, every reason against it now."""
    return {verb.value: reject_reasons(verb, situation) for verb in CONDITIONS}


def nobody_flies(now: Situation) -> Iterator[Reject]:
    """No drone is armed or in the air, under this ground or another."""
    flying = () if ARM_IN_AIR in now.without else now.flying
    if flying:
        yield Reason.FLYING.of()
    for link in (drone.link for drone in flying):
        if link.armed:
            yield Reason.ARMED_IN.of(link.name, link.mode)
        else:
            yield Reason.IN_AIR.of(link.name, link.telemetry.landed.name)


def somebody_flies(now: Situation) -> Iterator[Reject]:
    """Asked on the ground: some drone is armed, in the air or unheard."""
    if now.flight.phase is Phase.GROUND and not now.unheard and not now.flying:
        yield Reason.NONE_FLIES.of()


def no_other_ground(now: Situation) -> Iterator[Reject]:
    """No other ground is on the bus, and no drone answers one."""
    if ARM_OTHER_GROUND in now.without:
        return
    answers = (d.link.name for d in now.drones if d.link.answers_other_ground(now.now_ns))
    others = (*(f"ground {name}" for name in now.host.other_grounds), *(f"{n} answers another ground" for n in answers))
    if others:
        yield Reason.OTHER_GROUND.of(", ".join(others))


def bodies_ready(now: Situation) -> Iterator[Reject]:
    """Every body is seen and apart from the others; a drone is at rest inside the fence, level, heard and charged."""
    facts, limits = now.facts, now.config.limits
    fresh = facts.age_s <= UNSEEN_S
    outside_m = outside_box(facts.pos_lab_m, limits.fence.low_m, limits.fence.high_m)
    near_m = nearest(facts.pos_lab_m, fresh)
    for i, name in enumerate(facts.names):
        if name in now.excluded:
            continue
        if not fresh[i]:
            yield Reason.NO_POSE.of(name, _ago(facts.age_s[i]))
        elif facts.commanded[i]:
            yield from _pose_reasons(facts, i, float(outside_m[i]))
        if near_m[i] < limits.min_separation_m:
            yield Reason.TOO_NEAR.of(name, near_m[i], limits.min_separation_m)
        if facts.commanded[i]:
            yield from _link_reasons(facts, i, limits.battery_low_share)


def _pose_reasons(facts: Facts, i: int, outside_m: float) -> Iterator[Reject]:
    name = facts.names[i]
    if outside_m > 0.0:
        yield Reason.OUTSIDE_FENCE.of(name, outside_m)
    if facts.tilt_rad[i] > LEVEL_RAD:
        yield Reason.TILTED.of(name, np.degrees(facts.tilt_rad[i]))
    if facts.speed_m_s[i] > STILL_M_S:
        yield Reason.MOVING.of(name, facts.speed_m_s[i])


def _link_reasons(facts: Facts, i: int, battery_low_share: float) -> Iterator[Reject]:
    name = facts.names[i]
    if facts.heartbeat_age_s[i] > HEARTBEAT_S:
        yield Reason.NO_HEARTBEAT.of(name, _ago(facts.heartbeat_age_s[i]))
    if facts.battery[i] < battery_low_share:
        yield Reason.BATTERY_LOW.of(name, facts.battery[i])
    if facts.duplicate[i]:
        yield Reason.SYSID_TWICE.of(name)


def _ago(age_s: float) -> str:
    return f"{age_s:.1f} s ago" if isfinite(age_s) else "never"


def autopilots_ready(now: Situation) -> Iterator[Reject]:
    """Every autopilot is one that we know, ready to fly, with the parameters that a flight needs."""
    for drone in now.participants:
        yield from autopilot_reasons(drone.link)


def autopilot_reasons(link: DroneLink) -> Iterator[Reject]:
    """Every reason of one drone's link and parameters against flying it; the rules are the autopilot model's."""
    if link.foreign_sysid is not None:
        yield Reason.FOREIGN_DRONE.of(link.name, link.foreign_sysid, link.sysid)
    if link.telemetry.heartbeat is None:
        return  # `bodies_ready` reports a missing heartbeat
    if link.model is None:
        yield Reason.UNKNOWN_AUTOPILOT.of(link.name, link.telemetry.heartbeat.autopilot.name)
        return
    unready = link.model.unready(link.telemetry)
    if unready:
        yield Reason.AUTOPILOT_UNREADY.of(link.name, unready)
    for name in link.awaiting_restart:
        yield Reason.AWAITS_RESTART.of(link.name, name, restart_text(link))
    for rule in link.model.rules:
        if rule.rejects(link.parameters.values.get(rule.name)):
            yield Reason.WRONG_PARAMETER.of(link.name, _parameter_text(link, rule))


def log_written(now: Situation) -> Iterator[Reject]:
    """The log is written in time."""
    if now.host.log_trouble:
        yield Reason.LOG.of(now.host.log_trouble)


def stop_button_works(now: Situation) -> Iterator[Reject]:
    """The stop button is there, where one is configured."""
    if now.host.button_trouble:
        yield Reason.STOP_BUTTON.of(now.host.button_trouble)


def armed_drones_controllable(now: Situation) -> Iterator[Reject]:
    """Some drone is armed; each that is has a fresh pose and a ready autopilot."""
    armed = [drone for drone in now.drones if drone.link.armed]
    if not armed:
        yield Reason.NONE_ARMED.of()
    for drone in armed:
        if now.facts.age_s[drone.index] > UNSEEN_S:
            yield Reason.NO_POSE_TO_LEAD.of(drone.link.name)
    for drone in armed:
        yield from autopilot_reasons(drone.link)


def all_armed(now: Situation) -> Iterator[Reject]:
    """Every drone has reported off-board mode and armed."""
    if not now.flight.armed:
        yield Reason.NOT_ARMED.of()


def leader_and_follower(now: Situation) -> Iterator[Reject]:
    """A leader and a follower take part: one drone that is armed alone, to be identified, stays on the floor."""
    yield from lacking(now.config, now.excluded, LAND_AND_INCLUDE)


def lacking(config: LabConfig, excluded: Collection[str], instead: str = "") -> Iterator[Reject]:
    """Why nothing is formed without these bodies: the leader is among them, or every follower.

    instead: ": " and the command that does what is meant.
    """
    if config.leader.body in excluded:
        yield Reason.LEADER_NEEDED.of(config.leader.body, instead)
    elif config.followers and all(follower.body in excluded for follower in config.followers):
        yield Reason.NONE_LEFT.of(instead)


def time_to_lift_off(now: Situation) -> Iterator[Reject]:
    """No drone disarms by itself before it has lifted off."""
    for drone in now.drones:
        left_s = drone.disarms_in_s(now.now_ns)
        if left_s is not None and left_s < TAKE_OFF_S:
            yield Reason.DISARMS_ITSELF.of(drone.link.name, left_s, TAKE_OFF_S)


def all_joined(now: Situation) -> Iterator[Reject]:
    """Every drone that was taken over follows this ground, and nobody rises to join."""
    yield from (Reason.JOINING.of(drone.link.name) for drone in now.drones if drone.joining(now.now_ns))
    yield from (Reason.RISING.of(drone.link.name) for drone in now.drones if drone.rises)


def ready_to_join(now: Situation) -> Iterator[Reject]:
    """In flight: who is taken in stands ready, on the floor, and clear of all whom it would rise beside."""
    joiners = frozenset(now.flight.excluded) - frozenset(now.excluded)
    if now.flight.phase is not Phase.HOLD or not joiners:
        return
    alone = replace(now, excluded=frozenset(now.facts.names) - joiners)
    yield from all_joined(now)
    yield from (Reason.ARMED.of(drone.link.name) for drone in alone.participants if drone.link.armed)
    for condition in (bodies_ready, autopilots_ready, log_written, stop_button_works):
        yield from condition(alone)
    clear_m, pos_m, seen = PERSONAL_SPACE * now.config.limits.min_separation_m, now.facts.pos_lab_m, now.facts.age_s
    for i, k in permutations(range(len(pos_m)), 2):
        beside_m = float(np.hypot(*(pos_m[i] - pos_m[k])[:2]))
        if now.facts.names[i] in joiners and seen[k] <= UNSEEN_S and beside_m < clear_m:
            yield Reason.NOT_CLEAR.of(now.facts.names[i], beside_m, now.facts.names[k], clear_m)


def leader_seen(now: Situation) -> Iterator[Reject]:
    """The leader has a fresh pose."""
    if now.facts.age_s[0] > UNSEEN_S:
        yield Reason.LEADER_UNSEEN.of(now.config.leader.body)


def leader_seen_in_formation(now: Situation) -> Iterator[Reject]:
    """In formation, the leader has a fresh pose."""
    if now.flight.phase is Phase.FORMATION:
        yield from leader_seen(now)


def interrupted(now: Situation) -> Iterator[Reject]:
    """A hold has interrupted the leader's trajectory."""
    if now.flight.interrupted_s is None:
        yield Reason.NOT_INTERRUPTED.of()


def not_led_home(now: Situation) -> Iterator[Reject]:
    """The drones are not on their way to where they took off, in the shape in which they stood."""
    if now.flight.is_led_home:
        yield Reason.LED_HOME.of()


def all_stopped(now: Situation) -> Iterator[Reject]:
    """Every drone is heard and disarmed."""
    for drone in now.drones:
        if drone.link.armed:
            yield Reason.ARMED.of(drone.link.name)
    for drone in now.unheard:
        yield Reason.MAY_BE_ARMED.of(drone.link.name, _ago(drone.link.ages(now.now_ns).heartbeat_s))


def leader_commanded(now: Situation) -> Iterator[Reject]:
    """The leader is a drone."""
    if now.config.leader.sysid is None:
        yield Reason.LEADER_OBSERVED.of(now.config.leader.body)


def starts_known(now: Situation) -> Iterator[Reject]:
    """Every drone that flies took off under this ground."""
    for drone in now.participants:
        if drone.start_lab_m is None:
            yield Reason.NO_START.of(drone.link.name)


CONDITIONS: Mapping[Verb, tuple[Condition, ...]] = MappingProxyType(
    {
        Verb.ARM: (
            nobody_flies, no_other_ground, bodies_ready, autopilots_ready, log_written, stop_button_works,
        ),
        Verb.TAKE_CONTROL: (armed_drones_controllable, no_other_ground),
        Verb.TAKEOFF: (leader_and_follower, bodies_ready, autopilots_ready, all_armed, time_to_lift_off),
        Verb.START: (all_joined, leader_seen),
        Verb.RESUME: (leader_commanded, interrupted, all_joined, leader_seen),
        Verb.HOME: (leader_commanded, all_joined, leader_seen, starts_known),
        Verb.HOLD: (),
        Verb.LAND: (somebody_flies,),
        Verb.STOP: (),
        Verb.RESET: (all_stopped,),
        Verb.EXCLUDE: (),
        Verb.INCLUDE: (ready_to_join,),
        Verb.REPLACE: (),
        Verb.SHAPE: (leader_seen_in_formation, not_led_home),
        Verb.TRAJECTORY: (leader_commanded,),
        Verb.MOVE: (all_joined, leader_seen_in_formation, not_led_home),
    }
)  # fmt: skip
"""The conditions of each request, beside its phase (formation.safety.phases.TABLE), in the order of a flight."""


def parameter_warnings(link: DroneLink) -> tuple[tuple[str, str], ...]:
    """Parameters that were read and are not as wanted, but do not keep the drone on the ground, each with a text."""
    if link.model is None:
        return ()
    read = ((rule, link.parameters.values.get(rule.name)) for rule in link.model.rules)
    wrong = [rule for rule, found in read if found is not None and not rule.holds(found) and not rule.rejects(found)]
    return tuple((rule.name, _parameter_text(link, rule)) for rule in wrong) + _hover_warning(link)


def _hover_warning(link: DroneLink) -> tuple[tuple[str, str], ...]:
    used, expected = link.hover_thrust_norm, link.profile.hover_thrust_norm
    if link.model is None or abs(used - expected) <= HOVER_WITHIN * expected:
        return ()
    name = link.model.table.hover_parameter
    return ((name, f"{name} is {used:.2f}, the profile {link.profile.name} hovers at {expected:.2f}"),)


def restart_text(link: DroneLink) -> str:
    """Why a parameter that was set right keeps its drone on the ground, and what to do."""
    return (
        f"was changed and counts from a restart, which was not seen: restart the autopilot of drone {link.sysid} (off "
        "for 3 s) while gcs run or gcs doctor runs; or, where it was, delete ...-restarts.toml beside the lab file"
    )


def _parameter_text(link: DroneLink, rule: ParameterRule) -> str:
    found = link.parameters.values.get(rule.name)
    if found is not None:
        return f"{rule.name} is {found:g}, wanted {rule.wanted}: {rule.why}"
    return f"{rule.name} is being read" if link.parameters.reading else f"{rule.name} could not be read: {rule.why}"
