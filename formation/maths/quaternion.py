"""Rotations inside compiled loops, most written into an array that is there; batches: `formation.maths.frames`."""

from math import atan2, cos, sin, sqrt

import numpy as np

from formation.maths.arrays import Float
from formation.maths.kernel import kernel


@kernel
def multiply_into(a: Float, b: Float, out: Float) -> None:
    """out = a b, Hamilton; out may be neither of them."""
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]


@kernel
def rotate_into(q: Float, v: Float, out: Float) -> None:
    """out = R(q) v; out may not be v."""
    tx = 2.0 * (q[2] * v[2] - q[3] * v[1])
    ty = 2.0 * (q[3] * v[0] - q[1] * v[2])
    tz = 2.0 * (q[1] * v[1] - q[2] * v[0])
    out[0] = v[0] + q[0] * tx + q[2] * tz - q[3] * ty
    out[1] = v[1] + q[0] * ty + q[3] * tx - q[1] * tz
    out[2] = v[2] + q[0] * tz + q[1] * ty - q[2] * tx


@kernel
def matrix_into(q: Float, rot: Float) -> None:
    """rot (3, 3) = R(q)."""
    w, i, j, k = q[0], q[1], q[2], q[3]
    rot[0, 0] = 1.0 - 2.0 * (j * j + k * k)
    rot[0, 1] = 2.0 * (i * j - w * k)
    rot[0, 2] = 2.0 * (i * k + w * j)
    rot[1, 0] = 2.0 * (i * j + w * k)
    rot[1, 1] = 1.0 - 2.0 * (i * i + k * k)
    rot[1, 2] = 2.0 * (j * k - w * i)
    rot[2, 0] = 2.0 * (i * k - w * j)
    rot[2, 1] = 2.0 * (j * k + w * i)
    rot[2, 2] = 1.0 - 2.0 * (i * i + j * j)


@kernel
def heading_of(q: Float) -> float:
    """Heading of the body's forward axis about lab z, rad, of an attitude or of what begins with one."""
    w, i, j, k = q[0], q[1], q[2], q[3]
    return atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))


@kernel
def rotation_vector_of(q: Float, out: Float) -> None:
    """The rotation vector of q, the shorter way, rad, into out (3)."""
    sine = sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    sign = 1.0 if q[0] >= 0.0 else -1.0
    scale = 2.0 * sign if sine < 1e-9 else 2.0 * atan2(sine, sign * q[0]) * sign / sine
    for axis in range(3):
        out[axis] = scale * q[axis + 1]


@kernel
def turn_flu_rad(q_before: Float, q_after: Float) -> Float:
    """The rotation vector (3) between two attitudes, in the body's axes before it; the shorter way, rad."""
    inverse, q, turn = np.empty(4), np.empty(4), np.empty(3)
    inverse[0], inverse[1], inverse[2], inverse[3] = q_before[0], -q_before[1], -q_before[2], -q_before[3]
    multiply_into(inverse, q_after, q)
    rotation_vector_of(q, turn)
    return turn


@kernel
def turn_into(q: Float, rotation_rad: Float, out: Float) -> None:
    """out = q exp(rotation / 2) to second order, unit, w >= 0; for rotations much smaller than 1."""
    half = out.copy()
    half[0] = 1.0
    for axis in range(3):
        half[axis + 1] = 0.5 * rotation_rad[axis]
    multiply_into(q, half, out)
    norm = sqrt(out[0] * out[0] + out[1] * out[1] + out[2] * out[2] + out[3] * out[3])
    scale = 1.0 / norm if out[0] >= 0.0 else -1.0 / norm
    for k in range(4):
        out[k] *= scale


@kernel
def thrust_axis(q: Float) -> tuple[float, float, float]:
    """The body's z axis in `lab`, along which the rotors pull; q: q_lab_from_flu (4)."""
    qw, qx, qy, qz = q[0], q[1], q[2], q[3]
    return 2.0 * (qx * qz + qw * qy), 2.0 * (qy * qz - qw * qx), 1.0 - 2.0 * (qx * qx + qy * qy)


@kernel
def heading_axes(
    zx: float, zy: float, zz: float, yaw: float
) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """The body's x and y axes in `lab` where its z axis is (zx, zy, zz), zz > 0, and its x axis heads for `yaw`.

    x_b = y_C x z_b normalised, y_C = (-sin yaw, cos yaw, 0); y_b = z_b x x_b: Eq. (1)'s angles (Z-Y-X).
    """
    cy, sy = cos(yaw), sin(yaw)
    xx, xy, xz = zz * cy, zz * sy, -(zx * cy + zy * sy)
    length = sqrt(xx * xx + xy * xy + xz * xz)
    xx, xy, xz = xx / length, xy / length, xz / length
    return (xx, xy, xz), (zy * xz - zz * xy, zz * xx - zx * xz, zx * xy - zy * xx)


@kernel
def attitude_of(x: float, y: float, z: float, yaw: float, q: Float) -> None:
    """q_lab_from_flu with body z along the force (x, y, z), z > 0, and body x heading for `yaw`, into q (4)."""
    size = sqrt(x * x + y * y + z * z)
    zx, zy, zz = x / size, y / size, z / size
    (xx, xy, xz), (yx, yy, yz) = heading_axes(zx, zy, zz, yaw)
    # Shepperd's formula; tilt stays under pi/2, so the trace and m22 = zz share the safe branches.
    trace = xx + yy + zz
    if trace > zz:
        w = sqrt(1.0 + trace)
        q[0], q[1], q[2], q[3] = 0.5 * w, 0.5 * (yz - zy) / w, 0.5 * (zx - xz) / w, 0.5 * (xy - yx) / w
    else:
        w = sqrt(1.0 + zz - xx - yy)
        q[0], q[1], q[2], q[3] = 0.5 * (xy - yx) / w, 0.5 * (zx + xz) / w, 0.5 * (yz + zy) / w, 0.5 * w
    if q[0] < 0.0:
        for k in range(4):
            q[k] = -q[k]
