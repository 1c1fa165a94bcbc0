"""The oracle: whether nobody would have been hurt, by the simulated truth alone. Plain NumPy; nothing of the product.

A verdict is data: what was violated, when the fault began, when it was first noticed, how far a drone went from there.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

SEPARATION_M = 0.1
OUTSIDE_M = 0.5
IMPACT_M_S = 1.5
ACTING_AGE_S = 0.27
"""A setpoint accepted at 100 ms of age acts until the stream is stale, 150 ms later at most; 20 ms for clocks."""
STOP_S, REST_S = 0.3, 2.0
"""Within so long after an emergency stop no motor turns; so long after it the operator may have them armed again."""
COMMANDED_TILT_RAD = 1.05
AIRBORNE_M = 0.05
ON_FLOOR_M = 0.02
FALLING_SHARE, FALLING_S = 0.1, 0.15
"""So little of its weight as thrust, for so long, is no flying: its motors are as good as cut."""
UPSET_COS = 0.26
UPSET_WITHIN_S = 0.5
DEAD_GAIN, POWERLESS_GAIN = 0.5, 0.3
BRAKING_LIFT, BRAKING_S = 1.0 / 0.88, 0.3
"""Motors that give no more than this, of its weight, cannot brake it: 12 % of thrust are left to the attitude. So long
they need once they are sound again."""
CONTACT_S = 0.03
ALARM_S, KNOWN_S = 1.0, 0.3
"""Times within which the ground reports a failing log, and refuses to arm."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """True states of n drones at T instants, and the events reported; times in s, lab axes.

    up (T, n): the z component of each body's thrust axis; thrust, of its weight; command (T, n, 5): quaternion w, x, y,
    z and thrust that its attitude loop tracks; command_age_s: NaN while no ground's command acts; gain_low, gain_high:
    share of the commanded thrust of the weakest and the strongest motor; lift_most (T, n): maximum thrust over weight.
    notes: time, whether the event is unplanned, text. log_alarms_s, armed_s: when the ground reported a failing log,
    and began to arm. stops_s, arms_s: when an operator asked for an emergency stop, and for arming. log_ill_s: start
    and end of the times when the log could not be written. t_onset_s: NaN before any fault began. planned: whether the
    flight ended as the operator intended.
    """

    names: tuple[str, ...]
    t_s: Float
    pos_m: Float
    vel_m_s: Float
    up: Float
    armed: Bool
    thrust: Float
    command: Float
    command_age_s: Float
    gain_low: Float
    gain_high: Float
    lift_most: Float
    fence_low_m: Float
    fence_high_m: Float
    t_onset_s: float
    notes: tuple[tuple[float, bool, str], ...] = ()
    log_alarms_s: tuple[float, ...] = ()
    armed_s: tuple[float, ...] = ()
    stops_s: tuple[float, ...] = ()
    arms_s: tuple[float, ...] = ()
    log_ill_s: tuple[tuple[float, float], ...] = ()
    planned: bool = True


@dataclass(frozen=True, slots=True)
class Violation:
    """One thing that must not happen: its kind, when it first did, and how badly."""

    kind: str
    t_s: float
    text: str


@dataclass(frozen=True, slots=True)
class Margin:
    """How near a flight came to one limit: what share of it was used, more than 1 where it was violated, and when.

    t_s: when the limit was first passed, where it was; else when it was nearest.
    """

    kind: str
    t_s: float
    used: float
    text: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """onset_s: when the first fault began; detection_s: delay of its first report, None where there was none.

    drift_m: how far, sideways or up, a drone went from where it was at the onset. cause: the first event reported.
    margins: of separation, fence and impact, of each that came up, the least that was left.
    """

    violations: tuple[Violation, ...]
    onset_s: float | None
    detection_s: float | None
    drift_m: float
    cause: str = ""
    margins: tuple[Margin, ...] = ()
    kinds: tuple[str, ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "kinds", tuple(violation.kind for violation in self.violations))

    @property
    def contained(self) -> bool:
        """Whether nothing that must not happen did."""
        return not self.violations


def judge(truth: Truth, *, benign: bool = False, stop_within_s: float = STOP_S) -> Verdict:
    """The verdict on one flight; benign: its fault is one that must be flown through as planned."""
    airborne = truth.pos_m[:, :, 2] > AIRBORNE_M
    margins = [*_separation(truth, airborne), *_fence(truth, airborne), *_impacts(truth, airborne)]
    violations = [
        *(Violation(margin.kind, margin.t_s, margin.text) for margin in margins if margin.used > 1.0),
        *_overturned(truth, airborne),
        *_cuts(truth, airborne),
        *_commands(truth),
        *_stop(truth, stop_within_s),
        *_end(truth),
        *_unrecorded(truth),
    ]
    first = _first_note(truth)
    if not truth.planned and first is None:
        violations.append(
            Violation("no-cause", float(truth.t_s[-1]), "the flight did not end as planned, no cause reported")
        )
    if benign and not truth.planned:
        reason = "nothing reported" if first is None else first[1]
        violations.append(Violation("nuisance", first[0] if first else float(truth.t_s[-1]), reason))
    onset_s = None if np.isnan(truth.t_onset_s) else truth.t_onset_s
    detection_s = None if first is None or onset_s is None else first[0] - onset_s
    return Verdict(
        tuple(sorted(violations, key=lambda violation: violation.t_s)), onset_s, detection_s, _drift_m(truth),
        "" if first is None else first[1], _least(margins),
    )  # fmt: skip


def outside_m(pos_m: Float, low_m: Float, high_m: Float) -> Float:
    """How far each point is outside the box, along its worst axis; zero inside."""
    beyond: Float = np.maximum(low_m - pos_m, pos_m - high_m).max(axis=-1)
    return np.maximum(beyond, 0.0)


def _separation(truth: Truth, airborne: Bool) -> list[Margin]:
    """The separation margin of each pair that was in the air at once."""
    found = []
    for i in range(len(truth.names)):
        for j in range(i):
            separation_m = np.linalg.norm(truth.pos_m[:, i] - truth.pos_m[:, j], axis=-1)
            separation_m[~(airborne[:, i] & airborne[:, j])] = np.inf
            least = float(separation_m.min())
            if np.isfinite(least):
                text = f"{truth.names[j]} and {truth.names[i]} {least:.3f} m apart"
                found.append(_margin(truth, "separation", SEPARATION_M / np.maximum(separation_m, 1e-9), text))
    return found


def _fence(truth: Truth, airborne: Bool) -> list[Margin]:
    beyond = np.where(airborne, outside_m(truth.pos_m, truth.fence_low_m, truth.fence_high_m), 0.0)
    return [
        _margin(truth, "fence", beyond[:, i] / OUTSIDE_M, f"{name} {beyond[:, i].max():.2f} m outside")
        for i, name in enumerate(truth.names)
        if beyond[:, i].any()
    ]


def _impacts(truth: Truth, airborne: Bool) -> list[Margin]:
    """Speed at contact with the floor; of no account with the motors off for a good reason, or too weak to carry it.

    Too weak: while it tilts no farther than anybody may command. Motors that run in a body that turns over carry none.
    """
    found = []
    speed = np.linalg.norm(truth.vel_m_s, axis=-1)
    back = max(round(CONTACT_S / _dt_s(truth)), 1)
    for i, name in enumerate(truth.names):
        hits = np.zeros(len(truth.t_s))
        for k in _contacts(truth, i, airborne):
            lately = slice(max(k - round(BRAKING_S / _dt_s(truth)), 0), k + 1)
            held = truth.up[lately, i].min() >= np.cos(COMMANDED_TILT_RAD)
            weak = held and truth.lift_most[lately, i].min() < BRAKING_LIFT
            if not weak and (truth.armed[k, i] or not _rightly_cut(truth, i, k)):
                hits[k] = speed[max(k - back, 0) : k + 1, i].max()
        if hits.any():
            found.append(_margin(truth, "impact", hits / IMPACT_M_S, f"{name} met the floor at {hits.max():.1f} m/s"))
    return found


def _overturned(truth: Truth, airborne: Bool) -> list[Violation]:
    """Bodies that meet the floor turned over, with their motors on, although there was time to stop them."""
    found = []
    for i, name in enumerate(truth.names):
        over = truth.up[:, i] < np.cos(COMMANDED_TILT_RAD)
        since_s = truth.t_s - truth.t_s[over.argmax()]
        for k in _contacts(truth, i, airborne):
            if truth.armed[k, i] and over[k] and since_s[k] > STOP_S:
                found.append(
                    Violation("overturned", float(truth.t_s[k]), f"{name} met the floor turned over, motors on")
                )
                break
    return found


def _contacts(truth: Truth, i: int, airborne: Bool) -> list[int]:
    """The instants at which drone i meets the floor from the air."""
    back = 20 * max(round(CONTACT_S / _dt_s(truth)), 1)
    down = truth.pos_m[:, i, 2] < ON_FLOOR_M
    met = (np.flatnonzero(down[1:] & ~down[:-1]) + 1).tolist()
    return [k for k in met if airborne[max(k - back, 0) : k, i].any()]


def _cuts(truth: Truth, airborne: Bool) -> list[Violation]:
    """Motors cut in the air, or as good as, without a reason."""
    found = []
    for i, name in enumerate(truth.names):
        aloft = airborne[:, i]
        cut = np.flatnonzero(truth.armed[:-1, i] & ~truth.armed[1:, i] & aloft[1:]) + 1
        for k in cut.tolist():
            if not _rightly_cut(truth, i, k):
                height_m = float(truth.pos_m[k, i, 2])
                found.append(Violation("undue-cut", float(truth.t_s[k]), f"{name} cut {height_m:.2f} m up"))
                break
        idle = aloft & truth.armed[:, i] & (truth.thrust[:, i] < FALLING_SHARE)
        at = _lasting(idle, round(FALLING_S / _dt_s(truth)))
        if at is not None and truth.gain_high[at, i] >= POWERLESS_GAIN and not _rightly_cut(truth, i, at):
            found.append(Violation("undue-cut", float(truth.t_s[at]), f"{name} without thrust in the air"))
    return found


def _rightly_cut(truth: Truth, i: int, k: int) -> bool:
    """Whether by then the operator had asked for it, a motor was dead, or drone i was beyond recovery or far out."""
    t_s = truth.t_s[k]
    if any(stop_s <= t_s for stop_s in truth.stops_s):
        return True
    recent = (truth.t_s <= t_s) & (truth.t_s >= t_s - UPSET_WITHIN_S)
    upset = (truth.up[recent, i] < UPSET_COS).any()
    dead = truth.gain_low[: k + 1, i].min() < DEAD_GAIN
    far = outside_m(truth.pos_m[: k + 1, i], truth.fence_low_m, truth.fence_high_m).max() > OUTSIDE_M
    return bool(upset or dead or far)


def _commands(truth: Truth) -> list[Violation]:
    found = []
    flown = truth.armed
    age = np.where(flown, np.nan_to_num(truth.command_age_s), 0.0)
    w, x, y, z, thrust = np.moveaxis(truth.command, -1, 0)
    finite = np.isfinite(truth.command).all(axis=-1)
    length = w * w + x * x + y * y + z * z
    tilt = np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y) / np.maximum(length, 1e-9), -1.0, 1.0))
    bounded = finite & (abs(length - 1.0) < 0.01) & (thrust >= 0.0) & (thrust <= 1.0) & (tilt < COMMANDED_TILT_RAD)
    for i, name in enumerate(truth.names):
        if (age[:, i] > ACTING_AGE_S).any():
            old = age[:, i] > ACTING_AGE_S
            found.append(_at(truth, old, "command-age", f"{name} flown by a command {age[:, i].max():.2f} s old"))
        wrong = flown[:, i] & ~bounded[:, i]
        if wrong.any():
            worst = float(np.degrees(tilt[wrong, i].max()))
            found.append(_at(truth, wrong, "command-bounds", f"{name} commanded out of bounds, {worst:.0f} degrees"))
    return found


def _stop(truth: Truth, within_s: float) -> list[Violation]:
    """Effective and latched: no motor turns until somebody asks for it anew, later than it takes to come to rest."""
    after = np.zeros(len(truth.t_s), np.bool_)
    for stop_s in truth.stops_s:
        again_s = min((arm_s for arm_s in truth.arms_s if arm_s >= stop_s + REST_S), default=np.inf)
        after |= (truth.t_s > stop_s + within_s) & (truth.t_s < again_s)
    return [
        _at(truth, after & truth.armed[:, i], "stop", f"{name} armed {within_s:g} s and more after the stop")
        for i, name in enumerate(truth.names)
        if (after & truth.armed[:, i]).any()
    ]


def _end(truth: Truth) -> list[Violation]:
    """All motors off, on the floor."""
    t_s = float(truth.t_s[-1])
    return [
        Violation("no-end", t_s, f"{name} {'armed' if truth.armed[-1, i] else 'off'}, {truth.pos_m[-1, i, 2]:.2f} m up")
        for i, name in enumerate(truth.names)
        if truth.armed[-1, i] or truth.pos_m[-1, i, 2] > AIRBORNE_M
    ]


def _unrecorded(truth: Truth) -> list[Violation]:
    """The ground reports a log that cannot be written, and nobody arms with one."""
    found = []
    for begin_s, end_s in truth.log_ill_s:
        reported = any(begin_s <= t_s <= begin_s + ALARM_S for t_s in truth.log_alarms_s)
        if end_s - begin_s > ALARM_S and not reported:
            found.append(Violation("unrecorded", begin_s + ALARM_S, "a log that is not written, and no alarm"))
        found += [
            Violation("unrecorded", t_s, "armed with a log that is not written")
            for t_s in truth.armed_s
            if begin_s + KNOWN_S < t_s < end_s
        ]
    return found


def _first_note(truth: Truth) -> tuple[float, str] | None:
    """The first unplanned event from the onset on."""
    onset_s = -np.inf if np.isnan(truth.t_onset_s) else truth.t_onset_s
    return next(((t_s, text) for t_s, unplanned, text in truth.notes if unplanned and t_s >= onset_s), None)


def _drift_m(truth: Truth) -> float:
    if np.isnan(truth.t_onset_s):
        return 0.0
    after = truth.t_s >= truth.t_onset_s
    if not after.any():
        return 0.0
    moved = truth.pos_m[after] - truth.pos_m[after][0]
    moved[:, :, 2] = np.maximum(moved[:, :, 2], 0.0)
    return float(np.linalg.norm(moved, axis=-1).max())


def _dt_s(truth: Truth) -> float:
    return float(np.median(np.diff(truth.t_s)))


def _lasting(flags: Bool, count: int) -> int | None:
    """Where `count` in a row are first complete."""
    run = 0
    for k, flag in enumerate(flags.tolist()):
        run = run + 1 if flag else 0
        if run >= count:
            return k
    return None


def _at(truth: Truth, flags: Bool, kind: str, text: str) -> Violation:
    return Violation(kind, float(truth.t_s[int(flags.argmax())]), text)


def _margin(truth: Truth, kind: str, used: Float, text: str) -> Margin:
    """The margin by the share that was used of a limit at each instant."""
    at = int((used > 1.0).argmax() if (used > 1.0).any() else used.argmax())
    return Margin(kind, float(truth.t_s[at]), float(used.max()), text)


def _least(margins: list[Margin]) -> tuple[Margin, ...]:
    """The margin of each kind of which most was used."""
    kinds = dict.fromkeys(margin.kind for margin in margins)
    return tuple(max((m for m in margins if m.kind == kind), key=lambda m: m.used) for kind in kinds)
