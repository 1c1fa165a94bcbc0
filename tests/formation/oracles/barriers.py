"""The barriers in vectors: limits on speed and on closing, and the least change by trying every set of active pairs.

Imports nothing of the product.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from tests.formation.oracles.frames import G

BRAKE, REACTION, RATE, SPEED_RATE = 4.0, 0.25, 6.0, 6.0
SPEED, SEPARATION = 8, 32


@dataclass(frozen=True)
class Moving:
    """A body when the command takes hold; yields: it may be asked to give way; has: the acceleration that it has, of
    one that does not answer its commands; deaf: what is asked of it is of no account."""

    pos: np.ndarray
    vel: np.ndarray
    acc: np.ndarray
    controllable: bool = True
    has: np.ndarray | None = None
    unresponsive: bool = False

    def along(self, n: np.ndarray) -> float:
        """Its acceleration along n; of one that does not answer the lesser of what is asked and what is."""
        if self.has is None:
            return float(n @ self.acc)
        return float(n @ self.has if self.unresponsive else min(n @ self.acc, n @ self.has))


def least_pushes(normals: np.ndarray, excess: np.ndarray) -> np.ndarray:
    """Pushes (pairs) whose x = pushes @ normals (pairs, k) is the shortest with normals @ x >= excess.

    By the best of all active sets.
    """
    best, size = np.zeros(len(excess)), np.inf
    for count in range(len(excess) + 1):
        for active in combinations(range(len(excess)), count):
            rows = list(active)
            x = np.linalg.pinv(normals[rows]) @ excess[rows] if rows else np.zeros(normals.shape[1])
            if (normals @ x >= excess - 1e-9).all() and x @ x < size:
                best, size = np.zeros(len(excess)), x @ x
                best[rows] = np.linalg.pinv(normals[rows].T) @ x if rows else 0.0
    return best


def closing(a: Moving, b: Moving, separation: float) -> tuple[np.ndarray, float]:
    """The direction in which a parts from b, and by how much they accelerate together too hard."""
    gap = a.pos - b.pos
    distance = float(np.linalg.norm(gap))
    n = gap / distance
    speed = -float(n @ (a.vel - b.vel))
    across = np.linalg.norm(np.cross(n, a.vel - b.vel))
    if distance > separation:
        # c^2 / 2 + BRAKE REACTION c: what braking takes; the angular momentum of passing by helps.
        momentum = across * distance
        helps = momentum**2 * (separation**-2 - distance**-2)
        allowed = max(np.roots([1.0, 2.0 * BRAKE * REACTION, -2.0 * BRAKE * (distance - separation) - helps]).real)
        falls = (BRAKE + momentum**2 / distance**3) / (allowed + BRAKE * REACTION)
    else:
        allowed, falls = (distance - separation) / REACTION, 1.0 / REACTION
    towards = -a.along(n) - b.along(-n) - across**2 / max(distance, separation / 2.0)
    flat = n * [1.0, 1.0, 0.0] if np.degrees(np.arcsin(abs(n[2]))) <= 60.0 else n
    return flat, towards - (RATE * (allowed - speed) - falls * speed)


def slowed(body: Moving, speed_max: float) -> np.ndarray:
    """What takes away the acceleration along its velocity that would drive it beyond speed_max."""
    speed = float(np.linalg.norm(body.vel))
    if speed < 0.5 * speed_max:
        return np.zeros(3)
    along = body.vel / speed
    return -max(float(body.acc @ along) - SPEED_RATE * (speed_max - speed), 0.0) * along


def altered(bodies: list[Moving], separation: float, speed_max: float) -> tuple[np.ndarray, list[int]]:
    """Change (n, 3) of each acceleration, and the bits of what caused it."""
    change = np.array([slowed(b, speed_max) if b.controllable else np.zeros(3) for b in bodies])
    bits = [SPEED if c.any() else 0 for c in change]
    now = [replace(b, acc=b.acc + c) for b, c in zip(bodies, change, strict=True)]
    obeying = [replace(b, has=None) for b in now]
    rows, over = [], []
    for i, j in combinations(range(len(bodies)), 2):
        if now[i].controllable or now[j].controllable:
            n, excess = closing(now[i], now[j], separation)
            _, asked = closing(obeying[i], obeying[j], separation)
            row = np.zeros((len(bodies), 3))
            row[i], row[j] = n, -n
            free = np.array([[float(b.controllable)] for b in now])
            unresponsive = np.array([[float(b.has is not None)] for b in now])
            if (
                now[i].controllable and now[j].controllable and unresponsive[i] != unresponsive[j]
            ):  # each as if it were alone
                rows += [(row * (1.0 - unresponsive)).ravel(), (row * unresponsive).ravel()]
                over += [excess, asked]
            else:
                rows.append((row * free).ravel())
                over.append(max(excess, asked))
    if rows and max(over) > 0.0:
        apart = (least_pushes(np.array(rows), np.array(over)) @ np.array(rows)).reshape(-1, 3)
        bits = [b + (SEPARATION if x.any() else 0) for b, x in zip(bits, apart, strict=True)]
        change = change + apart
    return change, bits


def obeyed(acc: np.ndarray, lead: np.ndarray, change: np.ndarray, tilt: float) -> tuple[np.ndarray, np.ndarray]:
    """The demand with its change, and what inverts the lag: which may not undo it, as nothing across it may."""
    if not change.any():
        return acc, lead
    size = np.linalg.norm(change)
    lead = lead - min(lead @ change, 0.0) * change / size**2
    acc, flat = acc + change, change[:2] / (np.linalg.norm(change[:2]) or 1.0)
    reach = G * np.tan(tilt)
    if flat.any() and np.linalg.norm(acc[:2]) > reach:
        side = np.array([-flat[1], flat[0]])
        along = np.clip(acc[:2] @ flat, -reach, reach)
        most = np.sqrt(reach**2 - along**2)
        acc = np.array([*(along * flat + np.clip(acc[:2] @ side, -most, most) * side), acc[2]])
    return acc, lead
