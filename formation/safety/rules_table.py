"""The policy in flight, as one table: which faults there are, for how long they last, and who then acts how.

`RULES` is the whole of it; formation.safety.rules evaluates it, and the documentation prints it. The ground acts by a
trigger for the swarm (formation.safety.phases) and, where one drone is the trouble, by releasing that drone or cutting
its motors. Below all of this each drone's guard holds and lands it when setpoints go stale.
"""

from dataclasses import dataclass
from enum import IntEnum, StrEnum
from math import degrees

from formation.estimation.response import MISMATCH_WARN
from formation.messages import Phase, Severity
from formation.safety.attitude_innovation import MOST_RAD
from formation.safety.phases import AIRBORNE, Trigger

HEARTBEAT_S = 3.0
SILENT_S = 3.0
LATE_SETPOINT_S, STALE_SETPOINT_S = 0.07, 0.1
UNSEEN_S, LOST_S, LONG_LOST_S = 0.2, 0.4, 5.0
BEHIND_WARN_S, BEHIND_HOLD_S, BEHIND_RELEASE_S = 0.05, 0.1, 0.3
FAR_OUTSIDE_M = 0.5
UPSET_RAD = 1.3
UPSET_DEG = 5 * round(degrees(UPSET_RAD) / 5)
"""In words, to the nearest five."""
POSITION_ERROR_M, LEADER_POSITION_ERROR_M = 1.0, 0.3


class Own(StrEnum):
    """What happens to the one drone that a fault is about."""

    NOTHING = "-"
    RELEASE = "no more setpoints; commanded to land by itself"
    CUT = "motors cut"


class Measure(IntEnum):
    """What a rule looks at: a number for each vehicle, larger where things are worse; a flag counts as 0 or 1."""

    UNSEEN_S = 0
    OUTSIDE_M = 1
    NEARNESS = 2  # minus the distance to the nearest neighbour, in minimum separations
    POSITION_ERROR_M = 3
    TILT_RAD = 4
    SILENT_S = 5
    NOT_OFFBOARD = 6
    DISARMED = 7
    BATTERY_LOW = 8  # the lab's level less what is left of the charge
    LATE_SHARE = 9
    DUPLICATE = 10
    MODEL_MISMATCH = 11  # see formation.estimation.response
    OUTSIDE_TOO_M = 12  # as mocap and the drone's own estimator agree: the smaller of both
    TILT_TOO_RAD = 13
    SETPOINT_AGE_S = 14
    ATTITUDE_INNOVATION_RAD = 15
    LEADER_POSITION_ERROR_M = 16  # of the leader alone
    LINK_BEHIND_S = 17
    BATTERY_EMPTY = 18


@dataclass(frozen=True, slots=True)
class Rule:
    """One fault: the measure that is then over its limit, for how long, in which phases, and who then does what.

    name: by which a campaign switches it off. of_all: judged of bodies too that are only observed. of_swarm: the fault
    is nobody's own; it is raised once, at index 0, whoever that is.
    """

    name: str
    fault: str
    measure: Measure
    over: float
    persist_s: float
    phases: frozenset[Phase]
    swarm: Trigger | None = None
    own: Own = Own.NOTHING
    of_all: bool = False
    of_swarm: bool = False

    def text(self, name: str) -> str:
        """The fault of the vehicle `name`, in words."""
        return self.fault if self.of_swarm else f"{name}: {self.fault}"

    @property
    def severity(self) -> Severity:
        """The severity of its event."""
        if self.swarm is None and self.own is Own.NOTHING:
            return Severity.WARNING
        return Severity.ERROR if self.own is Own.NOTHING else Severity.CRITICAL


FLYING = AIRBORNE - {Phase.LAND}
TRACKING = frozenset({Phase.FORMATION, Phase.HOLD})
IN_FORMATION = frozenset({Phase.FORMATION})
MOTORS_ON = AIRBORNE | {Phase.ARMED}

RULES: tuple[Rule, ...] = (
    Rule("rule-unseen", f"body not seen for {UNSEEN_S:g} s",
         Measure.UNSEEN_S, UNSEEN_S, 0.0, IN_FORMATION, Trigger.HOLD, of_all=True),
    Rule("rule-lost", f"body not seen for {LOST_S:g} s",
         Measure.UNSEEN_S, LOST_S, 0.0, AIRBORNE, Trigger.LAND, Own.RELEASE),
    Rule("rule-long-lost", f"body not seen for {LONG_LOST_S:g} s",
         Measure.UNSEEN_S, LONG_LOST_S, 0.0, FLYING, Trigger.LAND, of_all=True),
    Rule("rule-outside-fence", "outside the fence",
         Measure.OUTSIDE_M, 0.0, 0.1, AIRBORNE, Trigger.LAND),
    Rule("rule-far-outside", f"{FAR_OUTSIDE_M:g} m outside the fence",
         Measure.OUTSIDE_M, FAR_OUTSIDE_M, 0.2, AIRBORNE, Trigger.LAND, Own.RELEASE),
    Rule("rule-far-outside-agreed", f"{FAR_OUTSIDE_M:g} m outside the fence, says its own estimate too",
         Measure.OUTSIDE_TOO_M, FAR_OUTSIDE_M, 0.2, AIRBORNE, Trigger.LAND, Own.CUT),
    Rule("rule-too-close", "closer than the minimum separation",
         Measure.NEARNESS, -1.0, 0.1, IN_FORMATION, Trigger.HOLD),
    Rule("rule-half-separation", "closer than half the minimum separation",
         Measure.NEARNESS, -0.5, 0.1, FLYING, Trigger.LAND),
    Rule("rule-position-error", f"{POSITION_ERROR_M:g} m away from its reference",
         Measure.POSITION_ERROR_M, POSITION_ERROR_M, 1.0, TRACKING, Trigger.LAND),
    Rule("rule-leader-position-error", f"{LEADER_POSITION_ERROR_M:g} m away from its reference, and it leads",
         Measure.LEADER_POSITION_ERROR_M, LEADER_POSITION_ERROR_M, 0.1, IN_FORMATION, Trigger.HOLD),
    Rule("rule-tilted", f"tilted by {UPSET_DEG} degrees",
         Measure.TILT_RAD, UPSET_RAD, 0.3, MOTORS_ON, Trigger.LAND, Own.RELEASE),
    Rule("rule-tilted-agreed", f"tilted by {UPSET_DEG} degrees, says its own attitude too",
         Measure.TILT_TOO_RAD, UPSET_RAD, 0.3, MOTORS_ON, Trigger.LAND, Own.CUT),
    Rule("rule-silent", f"nothing heard for {SILENT_S:g} s",
         Measure.SILENT_S, SILENT_S, 0.0, MOTORS_ON, Trigger.LAND),
    Rule("rule-link-behind", f"its telemetry arrives {1e3 * BEHIND_WARN_S:g} ms late",
         Measure.LINK_BEHIND_S, BEHIND_WARN_S, 1.0, MOTORS_ON),
    Rule("rule-link-behind-hold", f"its telemetry arrives {1e3 * BEHIND_HOLD_S:g} ms late",
         Measure.LINK_BEHIND_S, BEHIND_HOLD_S, 0.3, IN_FORMATION, Trigger.HOLD),
    Rule("rule-link-behind-release", f"its telemetry arrives {1e3 * BEHIND_RELEASE_S:g} ms late",
         Measure.LINK_BEHIND_S, BEHIND_RELEASE_S, 0.3, MOTORS_ON, Trigger.LAND, Own.RELEASE),
    Rule("rule-not-offboard", "not in off-board mode",
         Measure.NOT_OFFBOARD, 0.0, 0.5, FLYING, Trigger.LAND),
    Rule("rule-disarmed", "disarmed in the air",
         Measure.DISARMED, 0.0, 0.3, FLYING, Trigger.LAND),
    Rule("rule-setpoints-late", f"setpoints reach it {1e3 * LATE_SETPOINT_S:g} ms old",
         Measure.SETPOINT_AGE_S, LATE_SETPOINT_S, 1.0, MOTORS_ON),
    Rule("rule-setpoints-late-landing", f"setpoints reach it {1e3 * LATE_SETPOINT_S:g} ms old as it lands",
         Measure.SETPOINT_AGE_S, LATE_SETPOINT_S, 1.0, frozenset({Phase.LAND}), own=Own.RELEASE),
    Rule("rule-setpoints-stale", f"setpoints reach it {1e3 * STALE_SETPOINT_S:g} ms old",
         Measure.SETPOINT_AGE_S, STALE_SETPOINT_S, 1.0, MOTORS_ON, Trigger.LAND, Own.RELEASE),
    Rule("rule-battery-low", "battery low",
         Measure.BATTERY_LOW, 0.0, 1.0, MOTORS_ON),
    Rule("rule-battery-empty", "battery empty",
         Measure.BATTERY_EMPTY, 0.0, 1.0, MOTORS_ON, Trigger.LAND),
    Rule("rule-model-mismatch", "model mismatch",
         Measure.MODEL_MISMATCH, MISMATCH_WARN, 0.3, AIRBORNE),
    Rule("rule-attitude-innovation", "its attitude is not the mocap's: late poses?",
         Measure.ATTITUDE_INNOVATION_RAD, MOST_RAD, 0.1, AIRBORNE, Trigger.LAND, Own.RELEASE),
    Rule("rule-frames-late", "a fifth of the frames late",
         Measure.LATE_SHARE, 0.2, 0.5, MOTORS_ON, of_swarm=True),
    Rule("rule-frames-lost", "seven tenths of the frames late",
         Measure.LATE_SHARE, 0.7, 2.0, MOTORS_ON, Trigger.LAND, of_swarm=True),
    Rule("rule-duplicate-sysid", "its sysid is used twice on the network",
         Measure.DUPLICATE, 0.0, 0.0, frozenset(Phase)),
)  # fmt: skip
RULE_NAMES = tuple(rule.name for rule in RULES)


def rules_markdown() -> str:
    """The policy as the documentation shows it: a row a fault."""
    head = "| name | fault | after, s | in phases | the swarm | that drone |\n|---|---|---|---|---|---|"
    rows = (
        f"| `{rule.name}` | {rule.fault} | {rule.persist_s:g} | {_phases(rule)} | {_swarm(rule)} | {rule.own} |"
        for rule in RULES
    )
    return "\n".join((head, *rows))


def _phases(rule: Rule) -> str:
    return "any" if rule.phases == frozenset(Phase) else ", ".join(p.name for p in Phase if p in rule.phases)


def _swarm(rule: Rule) -> str:
    if rule.swarm is not None:
        return f"{rule.swarm}"
    return "warning only" if rule.own is Own.NOTHING else "-"
