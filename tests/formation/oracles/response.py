"""A first-order plant behind a dead time, in its state space: x' = A x by the exponential of A.

Imports nothing of the product.
"""

from itertools import pairwise

import numpy as np

SECONDS = 1e-9


def system(lag_s: float) -> np.ndarray:
    """A for the state (force, its integral, its double integral, input): lag f' = u - f, v' = f, x' = v."""
    return np.array([[-1.0 / lag_s, 0.0, 0.0, 1.0 / lag_s], [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0] * 4])


def step(h: float, lag_s: float) -> np.ndarray:
    """exp(A h), integrated row by row from exp(-h / lag)."""
    d = np.exp(-h / lag_s)
    once = lag_s * (1.0 - d)
    twice = lag_s * (h - once)
    return np.array(
        [[d, 0.0, 0.0, 1.0 - d], [once, 1.0, 0.0, h - once], [twice, h, 1.0, 0.5 * h**2 - twice], [0.0, 0.0, 0.0, 1.0]]
    )


def answered(
    sent_ns: np.ndarray, sent: np.ndarray, from_ns: int, to_ns: int, dead_s: float, lag_s: float, force: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force at to_ns and its two integrals since from_ns of lag f' = sent(t - dead) - f; sent (h, k), force (k)."""
    arrives = sent_ns + int(dead_s * 1e9)
    inside = arrives[(arrives > from_ns) & (arrives < to_ns)]
    edges = [from_ns, *(int(t) for t in np.unique(inside)), max(to_ns, from_ns)]
    state = np.vstack([force, np.zeros_like(force), np.zeros_like(force), np.zeros_like(force)])
    for a, b in pairwise(edges):
        known = np.nonzero(arrives <= a)[0]
        state[3] = sent[known[-1] if len(known) else 0]
        state = step((b - a) * SECONDS, lag_s) @ state
    return state[0], state[1], state[2]
