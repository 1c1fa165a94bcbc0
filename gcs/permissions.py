"""Why the ground refuses what an operator asks, decided here for every verb; and what it answers."""

from collections.abc import Iterable, Sequence
from math import isfinite

from formation.config import LabConfig
from formation.control.stack import Stages
from formation.messages import Phase, Verb
from formation.reasons import Reason, Reject
from formation.safety import arming
from formation.safety.phases import AFTER_STOP, Trigger
from formation.safety.rules import Facts
from formation.safety.rules_table import HEARTBEAT_S
from gcs import formation_change
from gcs.drones.checks import prearm_failures
from gcs.drones.drone import AIRBORNE_STATES, TAKE_OFF_S, Drone
from gcs.drones.link_state import DroneLink
from gcs.flight import Flight
from gcs.safety import ARM_IN_AIR, ARM_OTHER_GROUND, Host

OPERATORS = (
    Trigger.ARM, Trigger.TAKE_CONTROL, Trigger.TAKEOFF, Trigger.START, Trigger.HOLD, Trigger.LAND, Trigger.STOP,
    Trigger.RESET,
)  # fmt: skip
"""What an operator may pull, in the order of a flight."""


def flying(drones: Iterable[Drone]) -> tuple[Drone, ...]:
    """Drones that are armed, or report that they are in the air."""
    return tuple(drone for drone in drones if drone.link.armed or drone.link.telemetry.landed in AIRBORNE_STATES)


def arming_reject_reasons(up: Sequence[Drone], others: Sequence[str]) -> tuple[Reject, ...]:
    """Why this ground must not arm the drones now: some may be flying, or belong to another ground."""
    reasons = [_in_flight(drone.link) for drone in up]
    return (*((Reason.FLYING.of(),) if up else ()), *reasons, *_other_grounds(others))


def take_control_reject_reasons(
    drones: Sequence[Drone], facts: Facts, others: Sequence[str], seen: bool
) -> tuple[Reject, ...]:  # fmt: skip
    """Why this ground cannot take control; `land` and `stop` remain possible.

    seen: whether there is an estimate of the drones' positions.
    """
    armed = [drone for drone in drones if drone.link.armed]
    if not armed:
        return (Reason.NONE_ARMED.of(),)
    unseen = [d for d in armed if not seen or facts.age_s[d.index] > arming.FRESH_S]
    reasons = [Reason.NO_POSE_TO_LEAD.of(drone.link.name) for drone in unseen]
    reasons += [reason for drone in armed for reason in prearm_failures(drone.link)]
    return (*reasons, *_other_grounds(others))


def land_reject_reasons(drones: Sequence[Drone], now_ns: int) -> tuple[Reject, ...]:
    """Why nothing is left to land on the ground: every drone is heard, disarmed and not in the air."""
    unheard = any(drone.link.heartbeat_age_s(now_ns) > HEARTBEAT_S for drone in drones)
    return () if unheard or flying(drones) else (Reason.NONE_FLIES.of(),)


def joining_reject_reasons(drones: Iterable[Drone], now_ns: int) -> tuple[Reject, ...]:
    """Drones that do not follow this ground yet."""
    return tuple(Reason.JOINING.of(drone.link.name) for drone in drones if drone.joining(now_ns))


def landing_text(drones: Iterable[Drone]) -> str:
    """Why the drones can only be landed: the names of those that are landing already; empty where all fly."""
    down = [drone.link.name for drone in drones if drone.is_coming_down]
    return f"control taken to land: {', '.join(down)} on the floor, or landing already" if down else ""


def other_grounds(drones: Iterable[Drone], on_bus: Iterable[str], now_ns: int) -> tuple[str, ...]:
    """Every sign of another live ground: grounds on the bus, and drones that answer another ground."""
    answers = (d.link.name for d in drones if d.link.answers_other_ground(now_ns))
    return (*(f"ground {name}" for name in on_bus), *(f"{name} answers another ground" for name in answers))


def _other_grounds(others: Sequence[str]) -> tuple[Reject, ...]:
    return (Reason.OTHER_GROUND.of(", ".join(others)),) if others else ()


def _in_flight(link: DroneLink) -> Reject:
    if link.armed:
        return Reason.ARMED_IN.of(link.name, link.mode)
    return Reason.IN_AIR.of(link.name, link.telemetry.landed.name)


def _too_late(drones: Sequence[Drone], now_ns: int) -> tuple[Reject, ...]:
    """Who would disarm by itself before it has lifted off."""
    left_s = [drone.disarms_in_s(now_ns) for drone in drones]
    return tuple(
        Reason.DISARMS_ITSELF.of(drone.link.name, left, TAKE_OFF_S)
        for drone, left in zip(drones, left_s, strict=True)
        if left is not None and left < TAKE_OFF_S
    )


def armed_text(flight: Flight, now_ns: int) -> str:
    """What is said when every drone is armed: for how long they will be."""
    first = flight.first_to_disarm(now_ns)
    if first is None:
        return "every drone is armed"
    return f"every drone is armed; take off within {max(first[1] - TAKE_OFF_S, 0.0):.1f} s ({first[0]} disarms itself)"


def done_text(flight: Flight) -> str:
    """What is said of a request that was carried out at once."""
    trajectory = f", trajectory {flight.trajectory_name}" if flight.config.leader.trajectories else ""
    after = f"; {AFTER_STOP}" if flight.phase is Phase.STOPPED else ""
    return f"phase {flight.phase.name}, shape {flight.shape.name}{trajectory}{after}"


def reset_reject_reasons(drones: Sequence[Drone], now_ns: int) -> tuple[Reject, ...]:
    """Why a stop is not over: whose motors are on, or may be."""
    armed = tuple(Reason.ARMED.of(drone.link.name) for drone in drones if drone.link.armed)
    return armed + tuple(
        Reason.MAY_BE_ARMED.of(drone.link.name, _last_heartbeat(drone.link.heartbeat_age_s(now_ns)))
        for drone in drones
        if drone.link.heartbeat_age_s(now_ns) > HEARTBEAT_S
    )


def _last_heartbeat(age_s: float) -> str:
    return f"last heard {age_s:.1f} s ago" if isfinite(age_s) else "never heard"


class Permissions:
    """What stands against a request now, given the facts; the flight's phase table refuses what is out of turn."""

    def __init__(
        self, config: LabConfig, drones: Sequence[Drone], flight: Flight, host: Host, without: frozenset[str]
    ) -> None:  # fmt: skip
        """without: monitors that are switched off."""
        self._config = config
        self._drones = drones
        self._flight = flight
        self._host = host
        self._without = without

    def reject_reasons(self, verb: Verb, facts: Facts, stages: Stages | None, now_ns: int) -> tuple[Reject, ...]:
        """Every reason against the verb."""
        match verb, self._flight.phase:
            case Verb.ARM, Phase.GROUND:
                return self.arming(facts, now_ns)
            case Verb.TAKE_CONTROL, Phase.GROUND:
                others = self._other_grounds(now_ns)
                return take_control_reject_reasons(self._drones, facts, others, stages is not None)
            case Verb.LAND, Phase.GROUND:
                return land_reject_reasons(self._drones, now_ns)
            case Verb.RESET, Phase.STOPPED:
                return reset_reject_reasons(self._drones, now_ns)
            case Verb.TAKEOFF, Phase.ARMED:
                not_armed = () if self._flight.armed else (Reason.NOT_ARMED.of(),)
                return (*self._prearm_failures(facts), *not_armed, *_too_late(self._drones, now_ns))
            case Verb.START, Phase.HOLD:
                joining = joining_reject_reasons(self._drones, now_ns)
                return joining or formation_change.start(self._flight, facts, stages, self._flight.config)
            case _:
                return ()

    def allowed(
        self, facts: Facts, stages: Stages | None, arming: Sequence[Reject], now_ns: int
    ) -> dict[str, tuple[Reject, ...]]:  # fmt: skip
        """By verb, every reason against it now, without expensive checks: a shape's fit and its transition are judged
        when it is requested, or by the page. arming: the reasons against arming, where the swarm is on the ground."""
        reasons: dict[str, tuple[Reject, ...]] = {}
        for trigger in OPERATORS:
            out_of_turn = self._flight.out_of_turn(trigger)
            reasons[trigger.value] = (
                (out_of_turn,) if out_of_turn else self._against(trigger, facts, stages, arming, now_ns)
            )
        reasons[Verb.TRAJECTORY.value] = formation_change.choice_reject_reasons(self._flight)
        return reasons

    def _against(
        self, trigger: Trigger, facts: Facts, stages: Stages | None, arming: Sequence[Reject], now_ns: int
    ) -> tuple[Reject, ...]:  # fmt: skip
        if trigger is Trigger.ARM:
            return tuple(arming)
        if trigger is Trigger.START:
            return (
                *joining_reject_reasons(self._drones, now_ns),
                *formation_change.leader_reject_reasons(facts, self._config),
            )
        return self.reject_reasons(Verb(trigger.value), facts, stages, now_ns)

    def arming(self, facts: Facts, now_ns: int) -> tuple[Reject, ...]:
        """Every reason not to arm; first of all, that drones may be flying already, under this ground or another."""
        up = () if ARM_IN_AIR in self._without else flying(self._drones)
        trouble, button = self._host.log_trouble, self._host.button_trouble
        return (
            *arming_reject_reasons(up, self._other_grounds(now_ns)),
            *self._prearm_failures(facts),
            *((Reason.LOG.of(trouble),) if trouble else ()),
            *((Reason.STOP_BUTTON.of(button),) if button else ()),
        )

    def _prearm_failures(self, facts: Facts) -> tuple[Reject, ...]:
        links = (reject for drone in self._drones for reject in prearm_failures(drone.link))
        return (*arming.prearm_failures(facts, self._config.limits), *links)

    def _other_grounds(self, now_ns: int) -> tuple[str, ...]:
        if ARM_OTHER_GROUND in self._without:
            return ()
        return other_grounds(self._drones, self._host.other_grounds, now_ns)
