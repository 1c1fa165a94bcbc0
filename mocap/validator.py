"""The pose validator of a lab: rejects impossible poses, body by body. A rejected pose is unseen and has a reason.

Capture times are held against arrivals here, every pose against what its body can do by `mocap.pose_checks`. The checks
have names, which the manual's table shows, and can be switched off; rejections are reported when they begin and end.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from formation.config import LabConfig
from formation.maths import frames
from formation.maths.records import blank
from formation.messages import FROZEN_FRAMES, Event, LabFrame, Rejection, Severity
from mocap.pose_checks import (
    FASTEST_M_S,
    GAP_S,
    OBSERVED,
    RECOVERY_FRAMES,
    RELEARN_FRAMES,
    SPIN_RAD_S,
    UPSET_FRAMES,
    UPSET_M_S2,
    Criteria,
    Frame,
    Memory,
    bounds,
    judge,
)
from wire.clock_offset import LeastDelay
from wire.transport.frame_check import AHEAD_NS

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


def watched(without: frozenset[str]) -> frozenset[Rejection]:
    """The reasons that count without those checks."""
    return frozenset(Rejection) - {check.reason for check in CHECKS if check.name in without}


def checks_markdown() -> str:
    """The checks as the documentation shows them: a row a check."""
    rows = (f"| `{c.name}` | {c.rejects} | {c.detected} | {c.recovers} |" for c in CHECKS)
    return "\n".join(("| check | rejects | after | believed again after |", "|---|---|---|---|", *rows))


def name_of(reason: Rejection) -> str:
    """The check that has this reason, empty for a pose that is none."""
    return next((check.name for check in CHECKS if check.reason is reason), "")


SOURCE = "mocap"
QUIET_NS = 500_000_000
"""Rejections with shorter gaps form one episode, so that a flickering body does not fill the log."""


@dataclass(slots=True)
class _Episode:
    began_ns: int
    last_ns: int
    counts: Counter[Rejection] = field(default_factory=Counter)


class Episodes:
    """Those of a lab's bodies. `counts` holds all rejections since the start, by body and reason."""

    def __init__(self, bodies: tuple[str, ...]) -> None:
        self.counts: dict[str, Counter[Rejection]] = {body: Counter() for body in bodies}
        self._open: dict[str, _Episode] = {}
        self._events: list[Event] = []

    def note(self, frame: LabFrame, now_ns: int, detail: str = "") -> None:
        """Note the rejected poses of one frame; detail: what is known beside the reason."""
        for body, code in zip(frame.bodies, frame.rejected.tolist(), strict=True):
            if code:
                self._note(body, Rejection(code), now_ns, detail)

    def note_swaps(self, count: int, now_ns: int) -> None:
        """Note identity swaps that were corrected; count: pairs of bodies."""
        for _ in range(count):
            self._note("", Rejection.SWAP, now_ns)

    def due(self, now_ns: int) -> tuple[Event, ...]:
        """Events that are due."""
        if self._open:
            for body in [b for b, e in self._open.items() if now_ns - e.last_ns >= QUIET_NS]:
                self._close(body, self._open.pop(body))
        events, self._events = tuple(self._events), []
        return events

    def _note(self, body: str, reason: Rejection, now_ns: int, detail: str = "") -> None:
        if body:
            self.counts[body][reason] += 1
        if not name_of(reason):  # no valid pose: MocapCore's reject_log reports it
            return
        episode = self._open.get(body)
        if episode is None:
            episode = self._open[body] = _Episode(now_ns, now_ns)
            self._events.append(
                Event(Severity.WARNING, SOURCE, _began(body, reason, detail), code=name_of(reason), subject=body)
            )
        episode.last_ns = now_ns
        episode.counts[reason] += 1

    def _close(self, body: str, episode: _Episode) -> None:
        lasted_s = (episode.last_ns - episode.began_ns) * 1e-9
        counts = ", ".join(f"{count} x {name_of(reason)}" for reason, count in episode.counts.items())
        text = f"{body} is believed again" if body else "no bodies are swapped any more"
        self._events.append(Event(Severity.NOTICE, SOURCE, f"{text}: over {lasted_s:.2f} s, {counts}"))


def _began(body: str, reason: Rejection, detail: str) -> str:
    if not body:
        return f"{name_of(reason)}: two bodies were swapped; their poses are reassigned"
    return f"{body} is rejected, {name_of(reason)}: {detail or reason.text}"


SETTLED_FRAMES = 50


@dataclass(slots=True)
class StampWatch:
    """One source's least delay, from exposure to arrival."""

    _least: LeastDelay = field(default_factory=LeastDelay)
    _frames: int = 0
    _rejected: int = 0

    def rejects(self, t_capture_ns: int, now_ns: int, in_flight: bool) -> bool:
        """Whether the stamp is rejected. A lasting new delay is accepted while no drone flies."""
        delay_ns = now_ns - t_capture_ns
        least_ns = self._least.at_ns(now_ns)
        settled = least_ns is not None and self._frames >= SETTLED_FRAMES
        if delay_ns >= -AHEAD_NS and settled and least_ns is not None:
            wrong = not -EARLY_NS <= delay_ns - least_ns <= LATE_NS
            if wrong and not in_flight and self._rejected >= RELEARN_FRAMES:
                self._least, self._frames, wrong = LeastDelay(), 0, False
        else:
            wrong = delay_ns < -AHEAD_NS
        if wrong:
            self._rejected += 1
            return True
        self._least.offer(delay_ns, now_ns)
        self._frames, self._rejected = self._frames + 1, 0
        return False

    def why(self, t_capture_ns: int, now_ns: int) -> str:
        """The fault of a rejected stamp, in words."""
        usual_ms, ms = 1e-6 * (self._least.at_ns(now_ns) or 0), 1e-6 * (now_ns - t_capture_ns)
        if ms > usual_ms:
            what = "the network or a busy computer holds frames back, or the cameras' clock was set"
            return f"its frames come {ms:.0f} ms after their exposure, not {usual_ms:.0f}: {what}"
        return f"its frames are stamped {usual_ms - ms:.0f} ms too late: the cameras' clock was set"

    def likely_ns(self, now_ns: int) -> int:
        """When what arrives now was captured, if it took as long as the quickest did."""
        return now_ns - max(self._least.at_ns(now_ns) or 0, 0)


class PoseValidator:
    """Judges every body of every frame. `without`: names of checks that are switched off (mocap.validator)."""

    def __init__(self, config: LabConfig, without: frozenset[str] = frozenset()) -> None:
        counted = watched(without)
        self._bodies = tuple(v.body for v in config.vehicles)
        self._commanded = np.array([v.sysid is not None for v in config.vehicles])
        self._criteria = Criteria(
            bounds=bounds(config),
            q_marker_from_flu=frames.canonical(np.array([v.q_marker_from_flu for v in config.vehicles])),
            armed=np.zeros(len(self._bodies), np.bool_),
            armed_known=np.zeros(len(self._bodies), np.bool_),
            watched=np.array([reason in counted for reason in Rejection]),
        )
        self._memory = blank(Memory, len(self._bodies))
        self._stamps = StampWatch() if Rejection.STAMP in counted else None
        self._episodes = Episodes(self._bodies)

    def note_motors(self, on: Mapping[str, bool]) -> None:
        """Which drones have their motors on, as far as the ground knows; a body that is only observed leads them."""
        armed, armed_known = self._criteria.armed, self._criteria.armed_known
        for i, body in enumerate(self._bodies):
            if self._commanded[i] and body in on:
                armed[i], armed_known[i] = on[body], True
        armed[~self._commanded] = armed[self._commanded].any()
        armed_known[~self._commanded] = armed_known[self._commanded].all()

    def rejects_stamp(self, t_capture_ns: int, now_ns: int) -> bool:
        """Whether a frame that arrives now cannot have been captured then."""
        return self._stamps is not None and self._stamps.rejects(
            t_capture_ns, now_ns, True in self._criteria.armed.tolist()
        )

    def judge(self, frame: LabFrame, now_ns: int) -> LabFrame:
        """The frame with what is not believed unseen; its own arrays are written to."""
        swaps = judge(
            Frame(frame.t_capture_ns, frame.pos_lab_m, frame.q_lab_from_flu, frame.seen, frame.rejected),
            self._criteria, self._memory,
        )  # fmt: skip
        if swaps:
            self._episodes.note_swaps(swaps, now_ns)
        if any(frame.rejected.tolist()):
            self._episodes.note(frame, now_ns)
        return frame

    def without_poses(self, frame: LabFrame, earliest_ns: int, now_ns: int) -> LabFrame:
        """The frame without poses, for a rejected stamp; stamped with its likely time, not before earliest_ns."""
        likely_ns = now_ns if self._stamps is None else self._stamps.likely_ns(now_ns)
        t_ns = max(min(frame.t_capture_ns, likely_ns), earliest_ns)
        rejected = np.where(frame.seen, np.uint8(Rejection.STAMP), frame.rejected)
        without_poses = replace(frame, t_capture_ns=t_ns, seen=np.zeros(len(frame.seen), np.bool_), rejected=rejected)
        self._episodes.note(without_poses, now_ns, self._stamps.why(frame.t_capture_ns, now_ns) if self._stamps else "")
        return without_poses

    def events(self, now_ns: int) -> tuple[Event, ...]:
        """Events that are due: rejections that began, or ended."""
        return self._episodes.due(now_ns)

    def counts(self) -> dict[str, dict[str, int]]:
        """Poses rejected since the start, by body and reason; bodies without any are left out."""
        return {
            body: {name_of(reason) or reason.text: count for reason, count in counts.items()}
            for body, counts in self._episodes.counts.items()
            if counts
        }
