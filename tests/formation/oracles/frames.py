"""Rotations and rotating frames: matrices, cross products, Eq. (2); gravity. Imports nothing of the product."""

import numpy as np

G = 9.8
Z = np.array([0.0, 0.0, 1.0])


def rot_z(psi: float) -> np.ndarray:
    """R_lab_from_lead: a turn about z."""
    return np.array([[np.cos(psi), -np.sin(psi), 0.0], [np.sin(psi), np.cos(psi), 0.0], [0.0, 0.0, 1.0]])


def skew(v: np.ndarray) -> np.ndarray:
    """[v]x, so that skew(v) @ u = v x u."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def rotation_matrix(q: np.ndarray) -> np.ndarray:
    """R of a unit quaternion w, x, y, z: I + 2 w [u]x + 2 [u]x^2 (Rodrigues)."""
    u = skew(np.asarray(q[1:], dtype=np.float64))
    return np.eye(3) + 2.0 * q[0] * u + 2.0 * u @ u


def axis_angle(axis: np.ndarray, angle: float) -> np.ndarray:
    """R of a turn by `angle` about a unit axis (Rodrigues)."""
    u = skew(np.asarray(axis, dtype=np.float64))
    return np.eye(3) + np.sin(angle) * u + (1.0 - np.cos(angle)) * u @ u


def attitude_matrix(force: np.ndarray, yaw: float) -> np.ndarray:
    """R_lab_from_flu = Rz(psi) Ry(theta) Rx(phi) with R e_z along the force: the angles of Eq. (1)."""
    z = rot_z(yaw).T @ force / np.linalg.norm(force)  # (cos phi sin theta, -sin phi, cos phi cos theta)
    phi, theta = -np.arcsin(z[1]), np.arctan2(z[0], z[2])
    return rot_z(yaw) @ axis_angle(np.array([0.0, 1.0, 0.0]), theta) @ axis_angle(np.array([1.0, 0.0, 0.0]), phi)


def heading_of(r: np.ndarray) -> float:
    """Where the body's x axis points, about lab z."""
    return float(np.arctan2(r[1, 0], r[0, 0]))


def to_lead(motion: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Eq. (2) and its derivatives, lambda = R(psi_L)^T (p - p_L); motions (3, 4), of a frame that turns about z.

    In the frame itself d/dt(R^T r) = R^T (r' - W x r), applied twice.
    """
    out = motion - frame
    r, w, a = rot_z(frame[0, 3]).T, frame[1, 3] * Z, frame[2, 3] * Z
    p, v, acc = (motion[k, :3] - frame[k, :3] for k in range(3))
    out[0, :3] = r @ p
    out[1, :3] = r @ (v - np.cross(w, p))
    out[2, :3] = r @ (acc - 2.0 * np.cross(w, v) - np.cross(a, p) + np.cross(w, np.cross(w, p)))
    return out


def to_lab(motion: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """The way back: p = p_L + R lambda, and its derivatives with Coriolis, Euler and centripetal terms."""
    out = motion + frame
    r, w, a = rot_z(frame[0, 3]), frame[1, 3] * Z, frame[2, 3] * Z
    p, v, acc = (r @ motion[k, :3] for k in range(3))
    out[0, :3] = frame[0, :3] + p
    out[1, :3] = frame[1, :3] + v + np.cross(w, p)
    out[2, :3] = frame[2, :3] + acc + 2.0 * np.cross(w, v) + np.cross(a, p) + np.cross(w, np.cross(w, p))
    return out
