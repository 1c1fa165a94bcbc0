"""Proof of the mocap's axes, each body's name and each yaw zero, from drones moved by hand. Pure.

The operator stands every drone with its nose along the lab's x axis, then moves one at a time: forward along its nose,
left, up, and turns it left. Whatever the mocap saw instead says what is wrong with it.
"""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from formation.config import LabConfig
from formation.maths import frames
from formation.maths.arrays import Flags, Float, Quats, Vec3, Vec3s
from gcs.finding import Finding, Grade, graded, unmeasured

MOVED_M, TURNED_RAD = 0.1, np.radians(30.0)
FAR_MOVE_M = 20.0
ALIGNED_RAD, YAW_WITHIN_RAD = np.radians(12.0), np.radians(12.0)
LEAST_ALIKE = 0.8
DIRECTIONS = ("forward", "left", "up")
AXES = "axes"


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """All n bodies at one moment, as the configuration turns them into lab and flu; no pose counts of one not seen."""

    pos_lab_m: Vec3s
    q_lab_from_flu: Quats
    seen: Flags


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """One drone moved by hand: looks before the first move and after each of forward, left, up, and a left turn."""

    vehicle: int
    snapshots: tuple[Snapshot, Snapshot, Snapshot, Snapshot, Snapshot]

    def displacement(self, step: int) -> Vec3s:
        """How far every body went in step 0..2, (n, 3)."""
        moved: Vec3s = self.snapshots[step + 1].pos_lab_m - self.snapshots[step].pos_lab_m
        return moved


def check_axes(config: LabConfig, moved: Sequence[Moves]) -> tuple[Finding, ...]:
    """Judge every drone's moves."""
    return tuple(finding for moves in moved for finding in _check_drone(config, moves))


def _check_drone(config: LabConfig, moves: Moves) -> Iterator[Finding]:
    name = config.vehicles[moves.vehicle].body
    steps = [moves.displacement(k) for k in range(3)]
    seen = np.all([snapshot.seen for snapshot in moves.snapshots], axis=0)
    travel = np.where(seen, np.sum([np.linalg.norm(step, axis=-1) for step in steps], axis=0), 0.0)
    mover = int(np.argmax(travel))
    if travel[mover] < MOVED_M and not seen[moves.vehicle]:
        yield unmeasured(name, AXES, "x, y, z", "the mocap lost it while it was moved: repeat", Grade.FAIL)
        return
    if travel[mover] < MOVED_M:
        yield Finding(name, "body name", Grade.FAIL, "no body moved", name, "is this the drone that was moved?")
        return
    found = config.vehicles[mover].body
    why = f"the drone that was moved is {found} for the mocap: bodies are swapped"
    yield graded(name, "body name", found, name, mover == moves.vehicle, why)
    paths = np.stack([step[mover] for step in steps])
    if float(np.abs(paths).max()) > FAR_MOVE_M:
        size = f"{np.abs(paths).max():.0f} m by hand"
        yield Finding(name, "units", Grade.FAIL, size, "metres", "the mocap sends millimetres: set it to metres")
        paths = paths * 1e-3
    square = yield from _check_directions(config, name, paths)
    if square:
        yield from _check_yaw(config, moves, mover, paths[0])


def _check_directions(config: LabConfig, name: str, paths: Float) -> Generator[Finding, None, bool]:
    """Whether forward, left and up came out along x, y and z; else which rotation would put them there."""
    lengths = np.linalg.norm(paths, axis=-1)
    short = [DIRECTIONS[k] for k in range(3) if lengths[k] < MOVED_M]
    if short:
        yield Finding(name, AXES, Grade.FAIL, f"hardly moved {short[0]}", "a third of a metre", "move it farther")
        return False
    seen = (paths / lengths[:, None]).T  # columns: where forward, left and up went
    turn, alike = _nearest_turn(seen)
    if alike < LEAST_ALIKE:
        yield Finding(
            name, AXES, Grade.FAIL, _directions(seen), "x, y, z", "moves are not square to each other: repeat"
        )
        return False
    if np.linalg.det(turn) < 0.0:
        yield Finding(
            name, AXES, Grade.FAIL, _directions(seen), "x, y, z", "mirrored: the mocap's axes are left-handed"
        )
        return False
    if not np.array_equal(turn, np.eye(3)):
        q_lab_from_mocap = _rotation_to_write(config, turn)
        why = f"{_turn_words(turn)}: q_lab_from_mocap = [{', '.join(f'{x:.4f}' for x in q_lab_from_mocap)}]"
        yield Finding(name, AXES, Grade.FAIL, _directions(seen), "x, y, z", why)
        return False
    off = float(np.arccos(np.clip((np.trace(seen) - 1.0) / 2.0, -1.0, 1.0)))
    found = f"{_directions(seen)}, {np.degrees(off):.0f} deg off"
    yield graded(name, AXES, found, "x, y, z", off <= ALIGNED_RAD, "nose not along x, or axes a little turned", True)
    return True


def _check_yaw(config: LabConfig, moves: Moves, mover: int, forward: Vec3) -> Iterator[Finding]:
    """Whether the body's heading is where its nose went, and turns left when it is turned left."""
    name = config.vehicles[moves.vehicle].body
    q_before, q_after = moves.snapshots[3].q_lab_from_flu[mover], moves.snapshots[4].q_lab_from_flu[mover]
    nose = float(np.arctan2(forward[1], forward[0]))
    zero = float(frames.wrap_angle(frames.yaw(moves.snapshots[0].q_lab_from_flu[mover]) - nose))
    q_marker_from_flu = _alignment_to_write(config, mover, moves.snapshots[0].q_lab_from_flu[mover], nose)
    why = f"q_marker_from_flu = [{', '.join(f'{x:.4f}' for x in q_marker_from_flu)}]"
    found = f"{np.degrees(zero):+.0f} deg"
    yield graded(name, "yaw zero", found, "0 deg along the nose", abs(zero) <= YAW_WITHIN_RAD, why)
    turned = float(frames.wrap_angle(frames.yaw(q_after) - frames.yaw(q_before)))
    why = "turned right, or not enough: the marker frame is upside down, or the turn too small"
    yield graded(name, "turns left", f"{np.degrees(turned):+.0f} deg", "about +90 deg", turned >= TURNED_RAD, why)


def _nearest_turn(seen: Float) -> tuple[Float, float]:
    """The nearest signed permutation of the axes (a turn by right angles, or a mirror), and how alike it is, 0..1."""
    best, best_alike = np.eye(3), -1.0
    for order in permutations(range(3)):
        for signs in product((1.0, -1.0), repeat=3):
            turn = np.zeros((3, 3))
            turn[list(order), range(3)] = signs
            alike = float(np.sum(turn * seen, axis=0).min())
            if alike > best_alike:
                best, best_alike = turn, alike
    return best, best_alike


def _directions(seen: Float) -> str:
    """ "x, y, z" for moves that went forward, left and up."""
    words = []
    for k in range(3):
        axis = int(np.argmax(np.abs(seen[:, k])))
        words.append(("" if seen[axis, k] > 0.0 else "-") + "xyz"[axis])
    return ", ".join(words)


def _turn_words(turn: Float) -> str:
    if np.array_equal(turn[:, 2], [0.0, 1.0, 0.0]):
        return "the mocap is y-up"
    if turn[2, 2] == 1.0:
        angle = np.degrees(np.arctan2(turn[1, 0], turn[0, 0]))
        return f"the mocap frame is turned by {angle:.0f} degrees about up"
    return "the mocap's axes are permuted"


def _rotation_to_write(config: LabConfig, turn: Float) -> Float:
    """The q_lab_from_mocap that undoes `turn` on top of the configured one."""
    configured = frames.matrix(frames.canonical(np.array(config.mocap.q_lab_from_mocap)))
    return _quaternion(turn.T @ configured)


def _alignment_to_write(config: LabConfig, mover: int, q_lab_from_flu: Float, nose_rad: float) -> Float:
    """The q_marker_from_flu under which the body, as it stood, points where its nose went."""
    configured = frames.canonical(np.array(config.vehicles[mover].q_marker_from_flu))
    q_lab_from_marker = frames.multiply(q_lab_from_flu, frames.inverse(configured))
    return frames.canonical(frames.multiply(frames.inverse(q_lab_from_marker), frames.from_yaw(np.array(nose_rad))))


def _quaternion(rotation: Float) -> Float:
    """The quaternion of a rotation matrix: the eigenvector of its symmetric 4 x 4 form (Bar-Itzhack, 2000)."""
    r = rotation
    k = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[0, 1] + r[1, 0], r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[1, 2] + r[2, 1], r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    _, vectors = np.linalg.eigh(k)
    return frames.canonical(vectors[:, -1])
