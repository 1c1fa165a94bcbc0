"""From one shape to the next: who takes which slot, and a way there on which nobody comes near anybody.

Slots are dealt so that the sum of squared travel is least. Followers then move together, on straight lines in the
leader's frame, with the same minimum-jerk timing: such paths keep 1/sqrt(2) of the spacing that both shapes have
(Turpin, Michael, Kumar, CAPT, IJRR 2014). That says nothing of the leader, which stands in the midst of them, nor of
followers still on their way elsewhere. So the paths that will be flown are looked at as they are, and those that come
too near to another pass above or below it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from formation.guidance.reference_generator import add_gap
from formation.guidance.shape import Shape, separations
from formation.guidance.trajectory import braking_s, closing_s
from formation.maths.arrays import Bool, Float
from formation.maths.assignment import assignment
from formation.maths.frames import wrap_angle
from formation.maths.kernel import kernel

SAMPLES = 121
"""At so many times a way is looked at. Two 2 m apart at first pass each other 0.25 m off, seen 0.252 m off at worst."""
ATTEMPTS_EACH = 3
OWN_SHARE = 0.9


@dataclass(frozen=True, slots=True)
class Space:
    """What a change of shape must respect.

    min_separation_m: never to be broken; clearance_m: kept wherever both shapes have it themselves. low_m, high_m: how
    far below and above the leader a follower may pass. speed_m_s: along the way, in the leader's frame.
    """

    min_separation_m: float
    clearance_m: float
    low_m: float
    high_m: float
    speed_m_s: float


@dataclass(frozen=True, slots=True)
class Transition:
    """A change of shape that keeps everybody apart: rise_m as in formation.guidance.plan.Plan.

    separation_m: the least distance between any two on the way, leader included; duration_s: how long it takes.
    """

    shape: Shape
    rise_m: tuple[float, ...]
    separation_m: float
    duration_s: float


def assigned(shape: Shape, slot_now_lead_m: Float, forming: Bool | None = None) -> Shape:
    """The same shape with its slots dealt to the followers so that the sum of squared travel is least.

    slot_now_lead_m: (followers, 3). forming: which followers take a slot, the others get what is left; None: all.
    """
    gap = slot_now_lead_m[:, None, :] - shape.offsets[None, :, :]
    cost = np.sum(gap * gap, axis=-1)
    if forming is not None:
        cost[~forming] = 0.0
    slot_of = assignment(cost).tolist()
    return replace(
        shape,
        offset_lead_m=tuple(shape.offset_lead_m[j] for j in slot_of),
        yaw_offset_rad=tuple(shape.yaw_offset_rad[j] for j in slot_of),
    )


def transition(shape: Shape, motion_lead: Float, space: Space, names: Sequence[str]) -> Transition:
    """The way from motion_lead (followers, 3, 4) into the slots of `shape` as they are dealt.

    Motions are laid out as in formation.paper.eq2_relative_frame; names: of the leader and the followers. ValueError
    names the two that would come too near to each other.
    """
    paths = _Paths(shape, motion_lead, space)
    start, goal = separations(motion_lead[:, 0, :3]), separations(shape.offsets)
    _require_separation(goal, space, names, _leaves(shape))
    _require_separation(start, space, names, "already now there are")
    own = OWN_SHARE * float(min(start.min(), goal.min()))
    wanted = max(space.min_separation_m, min(space.clearance_m, own))
    for _ in range(ATTEMPTS_EACH * len(shape.offset_lead_m)):
        if paths.separation_m >= wanted or not paths.separate(wanted):
            break
    if paths.gaps[:, 3, 2].any():  # else they are still as they were sampled
        paths.sample()
    _require_separation(paths.distances_m, space, names, f"on the way to shape {shape.name} there would be")
    return Transition(shape, tuple(paths.gaps[:, 3, 2].tolist()), paths.separation_m, paths.duration_s)


def require_separation(shape: Shape, space: Space, names: Sequence[str]) -> None:
    """ValueError if any two, leader included, would be too near each other in their slots."""
    _require_separation(separations(shape.offsets), space, names, _leaves(shape))


def _leaves(shape: Shape) -> str:
    return f"shape {shape.name} leaves"


def _require_separation(distances_m: Float, space: Space, names: Sequence[str], words: str) -> None:
    """ValueError if any two are nearer than the minimum."""
    i, j = _nearest_pair(distances_m)
    if distances_m[i, j] < space.min_separation_m - 1e-9:
        raise ValueError(
            f"{words} {distances_m[i, j]:.2f} m between {names[i]} and {names[j]}, "
            f"minimum is {space.min_separation_m:.2f} m"
        )


def _nearest_pair(distances_m: Float) -> tuple[int, int]:
    i, j = np.unravel_index(int(np.argmin(distances_m)), distances_m.shape)
    return int(i), int(j)


class _Paths:
    """The ways of all followers as they would be flown, and how near they bring each to each.

    gaps (n, 4, 4): as in formation.guidance.reference_generator; apart (n + 1, n + 1): least distances on the way,
    leader first.
    """

    def __init__(self, shape: Shape, motion_lead: Float, space: Space) -> None:
        n = len(shape.offset_lead_m)
        self._base = np.column_stack([shape.offsets, shape.yaw_offset_rad])
        self._space = space
        self.gaps = np.zeros((n, 4, 4))
        self.gaps[:, :3] = motion_lead
        self.gaps[:, 0] -= self._base
        self.gaps[:, 0, 3] = wrap_angle(self.gaps[:, 0, 3])
        self.paths = np.zeros((n + 1, SAMPLES, 3))
        self.distances_m = np.empty((n + 1, n + 1))
        self.sample()

    @property
    def separation_m(self) -> float:
        """The least distance of all."""
        return float(self.distances_m.min())

    def separate(self, wanted_m: float) -> bool:
        """Let one of the two that come nearest pass above or below; False if nothing better is found."""
        best, chosen, height = self.separation_m + 1e-9, 0, 0.0
        for i in _nearest_pair(self.distances_m):
            if i == 0:
                continue  # the leader flies its own way
            rises = self._possible_rises(i, wanted_m)
            found = np.minimum(_if_risen(i, self._straight(i), rises, self.paths), wanted_m)
            if len(rises) and found.max() > best:
                best, chosen, height = float(found.max()), i, float(rises[np.argmax(found)])
        if chosen == 0:
            return False
        straight = self._straight(chosen)
        self.gaps[chosen - 1, 3, 2] = height
        straight[:, 2] += height * _BUMP
        self.paths[chosen] = straight
        self.distances_m[chosen] = self.distances_m[:, chosen] = _least_distances(chosen, straight, self.paths)
        return True

    def sample(self) -> None:
        """Follow everybody along the way, at the time it takes them all."""
        n = len(self.gaps)
        self.duration_s = max(closing_s(gap, braking_s(gap), self._space.speed_m_s) for gap in self.gaps)
        for i in range(n):
            _follow(self._base[i], self.gaps[i], braking_s(self.gaps[i]), self.duration_s, self.paths[i + 1])
        _all_distances(self.paths, self.distances_m)

    def _possible_rises(self, i: int, wanted_m: float) -> Float:
        """Heights at which body i would stay off the floor and the ceiling, best first."""
        level = self._straight(i)[:, 2]
        # In clearances, best first; none is out of the other's downwash, which reaches farther than rooms are high.
        rises = wanted_m * np.array((1.5, -1.5, 2.0, -2.0, 3.0, -3.0, 4.0, 5.0, 1.0, -1.0))
        paths = level + rises[:, None] * _BUMP
        low, high = min(self._space.low_m, float(level.min())), max(self._space.high_m, float(level.max()))
        inside: Float = rises[(paths.min(axis=1) >= low) & (paths.max(axis=1) <= high)]
        return inside

    def _straight(self, i: int) -> Float:
        """Body i's path (SAMPLES, 3) without its detour."""
        path: Float = self.paths[i].copy()
        path[:, 2] -= self.gaps[i - 1, 3, 2] * _BUMP
        return path


_SHARE = np.linspace(0.0, 1.0, SAMPLES)
_BUMP = 64.0 * (_SHARE * (1.0 - _SHARE)) ** 3


@kernel
def _follow(base: Float, gap: Float, brake_s: float, duration_s: float, out: Float) -> None:
    """Positions (SAMPLES, 3) along one way, evenly timed."""
    at = np.empty((3, 4))
    for k in range(len(out)):
        for order in range(3):
            for column in range(4):
                at[order, column] = base[column] if order == 0 else 0.0
        add_gap(gap, brake_s, duration_s * k / (len(out) - 1), duration_s, at)
        for axis in range(3):
            out[k, axis] = at[0, axis]


@kernel
def _if_risen(i: int, straight: Float, rises: Float, paths: Float) -> Float:
    """How near body i would come to any other if it passed this much above its straight path (SAMPLES, 3); (rises,)."""
    nearest = np.full(len(rises), np.inf)
    for r in range(len(rises)):
        for k in range(len(straight)):
            u = k / (len(straight) - 1)
            w = u * (1.0 - u)
            z = straight[k, 2] + rises[r] * 64.0 * w * w * w
            for j in range(len(paths)):
                if j != i:
                    dx, dy, dz = straight[k, 0] - paths[j, k, 0], straight[k, 1] - paths[j, k, 1], z - paths[j, k, 2]
                    nearest[r] = min(nearest[r], dx * dx + dy * dy + dz * dz)
        nearest[r] = sqrt(nearest[r])
    return nearest


@kernel
def _all_distances(paths: Float, out: Float) -> None:
    """How near all on paths (n + 1, SAMPLES, 3) come to each other, into out (n + 1, n + 1); infinite to themselves."""
    for i in range(len(paths)):
        out[i, i] = np.inf
        for j in range(i):
            out[i, j] = out[j, i] = _least_distance(paths[i], paths[j])


@kernel
def _least_distances(i: int, path: Float, paths: Float) -> Float:
    """How near body i, on `path` (SAMPLES, 3), comes to each of the others on paths (n + 1, SAMPLES, 3); (n + 1,)."""
    least = np.full(len(paths), np.inf)
    for j in range(len(paths)):
        if j != i:
            least[j] = _least_distance(path, paths[j])
    return least


@kernel
def _least_distance(path: Float, other: Float) -> float:
    """How near two come on their paths (SAMPLES, 3), at the same times."""
    least = np.inf
    for k in range(len(path)):
        dx, dy, dz = path[k, 0] - other[k, 0], path[k, 1] - other[k, 1], path[k, 2] - other[k, 2]
        square = dx * dx + dy * dy + dz * dz
        least = square if square < least else least
    return sqrt(least)
