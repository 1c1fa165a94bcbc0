"""The frames `lab`, `flu` and `lead`, and the rotations between them; the only file that knows two frames.

Quaternions are Hamilton, `w, x, y, z`, unit, w >= 0. Adjacent frame names cancel:
`v_lab = rotate(q_lab_from_flu, v_flu)`. All functions batch over leading axes.
(MAVLink's own axes exist only in `wire.mavlink.codec`.)
"""

from collections.abc import Sequence
from math import copysign, cos, sin

import numpy as np

from formation.maths.arrays import Float

One = Sequence[float]

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def canonical(q: Float) -> Float:
    """Unit quaternion(s) with w >= 0; shape (..., 4)."""
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0.0, -q, q)


def _components(vectors: Float) -> list[Float]:
    """The last axis apart, as `numpy.moveaxis` does in ten times the time."""
    vectors = np.asarray(vectors)
    return [vectors[..., k] for k in range(vectors.shape[-1])]


def multiply(q_a_from_b: Float, q_b_from_c: Float) -> Float:
    """Hamilton product: q_a_from_c; shapes (..., 4)."""
    w1, x1, y1, z1 = _components(q_a_from_b)
    w2, x2, y2, z2 = _components(q_b_from_c)
    return np.stack(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ],
        axis=-1,
    )


def inverse(q: Float) -> Float:
    """q_b_from_a of a unit q_a_from_b."""
    conjugate: Float = q * np.array([1.0, -1.0, -1.0, -1.0])
    return conjugate


def rotate(q_a_from_b: Float, v_b: Float) -> Float:
    """v_a = R(q_a_from_b) v_b; shapes (..., 4) and (..., 3)."""
    w, u = q_a_from_b[..., :1], q_a_from_b[..., 1:]
    t = 2.0 * np.cross(u, v_b)
    rotated: Float = v_b + w * t + np.cross(u, t)
    return rotated


def rotate_one(q_a_from_b: One, v_b: One) -> tuple[float, float, float]:
    """`rotate` of one vector, in plain floats: where a few come often, arrays cost five times as much."""
    w, x, y, z = q_a_from_b
    vx, vy, vz = v_b
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return vx + w * tx + y * tz - z * ty, vy + w * ty + z * tx - x * tz, vz + w * tz + x * ty - y * tx


def one_from_yaw(yaw_rad: float) -> tuple[float, float, float, float]:
    """`from_yaw` of one angle, in plain floats."""
    w, z = cos(0.5 * yaw_rad), sin(0.5 * yaw_rad)
    return copysign(w, 1.0), 0.0, 0.0, z if w >= 0.0 else -z


def matrix(q_a_from_b: Float) -> Float:
    """R_a_from_b of q_a_from_b; shape (..., 3, 3)."""
    columns = [rotate(q_a_from_b, np.broadcast_to(axis, (*q_a_from_b.shape[:-1], 3))) for axis in np.eye(3)]
    return np.stack(columns, axis=-1)


def yaw(q_lab_from_flu: Float) -> Float:
    """Heading of the body's forward axis about lab z, rad, (-pi, pi]; shape (...)."""
    w, x, y, z = _components(q_lab_from_flu)
    heading: Float = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return heading


def from_yaw(yaw_rad: Float) -> Float:
    """q_lab_from_lead: rotation by yaw about z; shape (..., 4)."""
    half = 0.5 * np.asarray(yaw_rad, dtype=np.float64)
    zero = np.zeros_like(half)
    return canonical(np.stack([np.cos(half), zero, zero, np.sin(half)], axis=-1))


def from_rotation_vector(rotation_rad: Float) -> Float:
    """Quaternion of a rotation vector (axis times angle); shape (..., 4)."""
    angle = np.linalg.norm(rotation_rad, axis=-1, keepdims=True)
    half_sinc = 0.5 * np.sinc(0.5 * angle / np.pi)
    return canonical(np.concatenate([np.cos(0.5 * angle), half_sinc * rotation_rad], axis=-1))


def from_euler(roll_rad: Float, pitch_rad: Float, yaw_rad: Float) -> Float:
    """Quaternion of yaw about z, then pitch about the new y, then roll about the new x; shapes (...), (..., 4)."""
    x, y, z = (
        from_rotation_vector(np.multiply.outer(angle, axis))
        for angle, axis in zip((roll_rad, pitch_rad, yaw_rad), np.eye(3), strict=True)
    )
    return canonical(multiply(multiply(z, y), x))


def rotation_vector(q_a_from_b: Float) -> Float:
    """Axis times angle of unit quaternion(s), the shorter way, rad; shapes (..., 4), (..., 3)."""
    q = canonical(q_a_from_b)
    angle = 2.0 * np.arctan2(np.linalg.norm(q[..., 1:], axis=-1, keepdims=True), q[..., :1])
    vector: Float = 2.0 * q[..., 1:] / np.sinc(0.5 * angle / np.pi)
    return vector


def interpolated(t_s: Float, q: Float, at_s: Float) -> Float:
    """Attitudes at other times, between neighbours the shorter way; shapes (T,) rising, (T, 4), (K,) and (K, 4)."""
    turned = np.sum(q[1:] * q[:-1], axis=-1) < 0.0
    signs = np.append(1.0, np.where(np.cumsum(turned) % 2, -1.0, 1.0))[:, None]
    return canonical(np.stack([np.interp(at_s, t_s, part) for part in (q * signs).T], axis=-1))


def rotate_about_z(yaw_rad: Float, v_lead: Float) -> Float:
    """v_lab of v_lead for a lead frame at heading yaw (Eq. 2 inverted); shapes (...), (..., 3)."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y, z = _components(v_lead)
    return np.stack([c * x - s * y, s * x + c * y, z], axis=-1)


def wrap_angle(angle_rad: Float) -> Float:
    """The same angle in (-pi, pi]."""
    wrapped: Float = -((-angle_rad + np.pi) % (2.0 * np.pi) - np.pi)
    return wrapped
