"""The phase table: what each trigger does in each phase. The swarm has one phase; there is no other state of flight.

Operators and safety pull the same triggers, so a landing is the same landing whoever asked for it.
"""

from collections.abc import Mapping
from enum import StrEnum
from types import MappingProxyType

from formation.messages import Phase, Verb


class Trigger(StrEnum):
    """What can change the phase: an operator's or safety's wish, or something seen to have happened."""

    ARM = "arm"
    TAKE_CONTROL = "take_control"  # of drones that fly without a ground
    TAKEOFF = "takeoff"
    START = "start"
    HOLD = "hold"
    LAND = "land"
    STOP = "stop"
    RESET = "reset"  # back from a stop, on the floor
    AT_HEIGHT = "at height"  # every commanded drone has reached its take-off height
    DISARMED = "disarmed"  # every commanded drone is disarmed, or arming failed and was undone


TABLE: Mapping[tuple[Phase, Trigger], Phase] = MappingProxyType(
    {
        (Phase.GROUND, Trigger.ARM): Phase.ARMED,
        (Phase.GROUND, Trigger.TAKE_CONTROL): Phase.HOLD,
        (Phase.GROUND, Trigger.LAND): Phase.LAND,  # each by its autopilot: nobody here leads it
        (Phase.ARMED, Trigger.TAKEOFF): Phase.TAKEOFF,
        (Phase.ARMED, Trigger.LAND): Phase.GROUND,
        (Phase.ARMED, Trigger.DISARMED): Phase.GROUND,
        (Phase.TAKEOFF, Trigger.AT_HEIGHT): Phase.HOLD,
        (Phase.TAKEOFF, Trigger.HOLD): Phase.HOLD,
        (Phase.TAKEOFF, Trigger.LAND): Phase.LAND,
        (Phase.HOLD, Trigger.START): Phase.FORMATION,
        (Phase.HOLD, Trigger.HOLD): Phase.HOLD,
        (Phase.HOLD, Trigger.LAND): Phase.LAND,
        (Phase.FORMATION, Trigger.HOLD): Phase.HOLD,
        (Phase.FORMATION, Trigger.LAND): Phase.LAND,
        (Phase.LAND, Trigger.LAND): Phase.LAND,
        (Phase.LAND, Trigger.DISARMED): Phase.GROUND,
        (Phase.STOPPED, Trigger.LAND): Phase.STOPPED,
        (Phase.STOPPED, Trigger.RESET): Phase.GROUND,
        **{(phase, Trigger.STOP): Phase.STOPPED for phase in Phase},
    }
)

AFTER_STOP = "when every drone is disarmed and heard, `gcs reset` leads back to GROUND"
"""What to do next in STOPPED, which no flight goes through."""

AFTER_HOLD = "`start` or `resume` by the operator leads on"
"""What to do next in HOLD: nothing resumes by itself, whatever the cause and though it be over."""

LEADS_ON: Mapping[Phase, str] = MappingProxyType(
    {
        Phase.GROUND: "`gcs arm`, then `gcs takeoff` begin a flight",
        Phase.ARMED: "`gcs takeoff` leads on, `gcs land` disarms",
        Phase.TAKEOFF: "HOLD comes when every drone is at its height",
        Phase.FORMATION: "`gcs hold` leads to HOLD, `gcs land` down",
        Phase.HOLD: "`gcs start` leads on, `gcs land` down",
        Phase.LAND: "GROUND comes when every drone is down and disarmed",
        Phase.STOPPED: AFTER_STOP,
    }
)
"""For an operator whose request is for other phases: how these come."""

STREAMING = frozenset({Phase.ARMED, Phase.TAKEOFF, Phase.FORMATION, Phase.HOLD, Phase.LAND})
"""Phases in which every commanded drone is sent setpoints."""

AIRBORNE = frozenset({Phase.TAKEOFF, Phase.FORMATION, Phase.HOLD, Phase.LAND})
"""Phases in which drones may be off the floor."""


def advance(phase: Phase, trigger: Trigger) -> Phase | None:
    """The phase that `trigger` leads to, or None where it means nothing in this phase."""
    return TABLE.get((phase, trigger))


def allowed_from(trigger: Trigger) -> tuple[Phase, ...]:
    """The phases that allow `trigger`; a rejection lists them for the operator."""
    return tuple(phase for phase in Phase if (phase, trigger) in TABLE)


CHANGES_NO_PHASE: Mapping[Verb, tuple[Phase, ...]] = MappingProxyType(
    {
        Verb.EXCLUDE: (Phase.GROUND, Phase.STOPPED),
        Verb.INCLUDE: (Phase.GROUND, Phase.HOLD),
        Verb.REPLACE: (Phase.GROUND,),
        Verb.RESUME: (Phase.HOLD,),
        Verb.HOME: (Phase.HOLD, Phase.FORMATION),
        Verb.MOVE: (Phase.HOLD, Phase.FORMATION),
        # Neither while the leader flies one, nor while it waits for its slots to be taken.
        Verb.TRAJECTORY: (Phase.GROUND, Phase.ARMED, Phase.TAKEOFF, Phase.HOLD),
        **dict.fromkeys((Verb.SHAPE, Verb.ACKNOWLEDGE, Verb.STATUS), tuple(Phase)),
    }
)
"""Requests that are no triggers, and the phases that they are for."""


PHASES_FOR: Mapping[Verb, tuple[Phase, ...]] = MappingProxyType(
    {
        **{verb: tuple(Phase) for verb in Verb},
        **{Verb(trigger.value): allowed_from(trigger) for trigger in Trigger if trigger.value in set(Verb)},
        **CHANGES_NO_PHASE,
    }
)
"""The phases in which a request may be made."""


def meant(verb: Verb, phase: Phase) -> str:
    """The command that does what is meant by a request that is not for this phase."""
    in_flight = phase in (Phase.TAKEOFF, Phase.FORMATION, Phase.HOLD)
    return "`gcs land BODY` lands that drone alone" if verb is Verb.EXCLUDE and in_flight else LEADS_ON[phase]


def table_markdown() -> str:
    """The table as the documentation shows it: a row a phase, a column a trigger."""
    header = "| phase | " + " | ".join(trigger.value for trigger in Trigger) + " |"
    rule = "|---" * (len(Trigger) + 1) + "|"
    rows = (
        f"| {phase.name} | " + " | ".join(_cell(advance(phase, trigger)) for trigger in Trigger) + " |"
        for phase in Phase
    )
    return "\n".join((header, rule, *rows))


def _cell(phase: Phase | None) -> str:
    return "-" if phase is None else phase.name
