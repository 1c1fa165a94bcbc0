"""Rotations inside compiled loops, each written into an array that is there; batches: `formation.maths.frames`."""

from math import sqrt

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
