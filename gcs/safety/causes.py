"""The first cause of what a rule finds of a drone: what was known of it before, where the rule sees only the effect."""

from formation.messages import rejection_text
from formation.safety.rules import FaultChange
from formation.safety.rules_table import BEHIND_HOLD_S, Measure
from gcs.drones.link_state import DroneLink

UNHEARD_S = 0.5
"""Nothing of a drone for so long, of the hundred packets a second that it sends, ended before its motion went wrong."""
_EFFECTS = frozenset(
    {
        Measure.UNSEEN_S, Measure.POSITION_ERROR_M, Measure.LEADER_POSITION_ERROR_M, Measure.NOT_OFFBOARD,
        Measure.DISARMED, Measure.MODEL_MISMATCH, Measure.ATTITUDE_INNOVATION_RAD,
    }
)  # fmt: skip


def with_cause(change: FaultChange, link: DroneLink, rejected: int, now_ns: int) -> str:
    """The text of a fault that begins, with its first cause. rejected: why the mocap rejects its pose (Rejection)."""
    cause = _first_cause(change, link, rejected, now_ns) if change.rule.measure in _EFFECTS else ""
    return f"{change.text} ({cause})" if cause else change.text


def _first_cause(change: FaultChange, link: DroneLink, rejected: int, now_ns: int) -> str:
    if link.guard_words(now_ns):
        return f"its guard: {link.guard_words(now_ns)}"
    if change.rule.measure is not Measure.UNSEEN_S:
        return "nothing is heard of it" if link.silent_s(now_ns) > UNHEARD_S else ""
    if rejected:
        return f"the mocap rejects its pose: {rejection_text(rejected)}"
    late = link.behind_s(now_ns) > BEHIND_HOLD_S
    return "its telemetry comes late: a slow link, or a busy computer" if late else ""
