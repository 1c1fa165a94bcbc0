"""The pose validator's checks by name: what each rejects, and after how many frames. The manual's table shows them."""

from collections.abc import Iterable
from dataclasses import dataclass

from formation.rejection import Rejection
from mocap.validator.bounds import FASTEST_M_S, OBSERVED, SPIN_RAD_S
from mocap.validator.judge import FROZEN_FRAMES, GAP_S, RECOVERY_FRAMES, UPSET_FRAMES, UPSET_M_S2

EARLY_NS = 10_000_000
"""How much less than the least delay known a delay may be."""
LATE_NS = 150_000_000
"""How much more: an older pose is too old to fly by."""


@dataclass(frozen=True, slots=True)
class Check:
    """One check: its name, its reason on the bus, its limits in words, frames to detection, and to recovery."""

    name: str
    reason: Rejection
    rejects: str
    detected: str
    recovers: str


_LASTING = f"{RECOVERY_FRAMES} frames of another path, within reach"

CHECKS = (
    Check(
        "validator-freeze", Rejection.FREEZE,
        "a pose that stays the same to the last bit, of a body whose pose varied while it stood, or that flies; "
        "the first such frame already counts as not seen",
        f"{FROZEN_FRAMES} frames", f"{RECOVERY_FRAMES} frames that differ",
    ),
    Check(
        "validator-jump", Rejection.JUMP,
        "a step beyond 4 cm and what full thrust and gravity can do since it was last believed "
        f"(only observed: {100 * OBSERVED.step_m:g} cm and {OBSERVED.acc_m_s2:g} m/s²), or beyond {FASTEST_M_S:g} m/s",
        "1 frame", _LASTING,
    ),
    Check(
        "validator-flip", Rejection.FLIP,
        "a turn about x and y beyond 0.2 rad and thrice the vehicle's rate "
        f"(only observed: {OBSERVED.turn_step_rad:g} rad and {OBSERVED.turn_rad_s:g} rad/s)",
        "1 frame", _LASTING,
    ),
    Check(
        "validator-flip", Rejection.FLIP,
        f"an attitude in flight whose rotors would push downwards with {UPSET_M_S2:g} m/s², by the acceleration seen",
        f"{UPSET_FRAMES} frames", f"{RECOVERY_FRAMES} frames",
    ),
    Check(
        "validator-yaw-rate", Rejection.YAW_RATE,
        "a turn about z beyond 0.1 rad and what two motors alone can do since it was last believed "
        f"(only observed: {OBSERVED.yaw_step_rad:g} rad and {OBSERVED.yaw_acc_rad_s2:g} rad/s²), or beyond "
        f"{SPIN_RAD_S:g} rad/s",
        "1 frame", _LASTING,
    ),
    Check(
        "validator-swap", Rejection.SWAP,
        f"two bodies, each where the other must be, or after a gap of up to {GAP_S:g} s is by far nearer to: "
        "set right if their attitudes fit as well, else both rejected",
        "1 frame", "set right at once, else as a jump",
    ),
    Check(
        "validator-stamp", Rejection.STAMP,
        f"a capture {EARLY_NS / 1e6:g} ms nearer to its arrival than ever before, or {LATE_NS / 1e6:g} ms farther",
        "1 frame", "1 frame",
    ),
)  # fmt: skip

NAMES = tuple(dict.fromkeys(check.name for check in CHECKS))
"""The monitors of the pose validator, each of which can be switched off."""


def watched(without: Iterable[str]) -> frozenset[Rejection]:
    """The reasons that count without those checks; ValueError for a check that is none."""
    off = frozenset(without)
    unknown = off.difference(NAMES)
    if unknown:
        raise ValueError(f"no check of the pose validator: {', '.join(sorted(unknown))}; known: {', '.join(NAMES)}")
    return frozenset(Rejection) - {check.reason for check in CHECKS if check.name in off}


def checks_markdown() -> str:
    """The checks as the documentation shows them: a row a check."""
    rows = (f"| `{c.name}` | {c.rejects} | {c.detected} | {c.recovers} |" for c in CHECKS)
    return "\n".join(("| check | rejects | after | believed again after |", "|---|---|---|---|", *rows))


def name_of(reason: Rejection) -> str:
    """The check that has this reason, empty for a pose that is none."""
    return next((check.name for check in CHECKS if check.reason is reason), "")
