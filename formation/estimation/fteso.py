"""One axis, one step: the finite-time extended state observer, and what tells noise from a push. Kernels only."""

from math import exp, pi, sqrt

from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.maths.powers import implicit_root, sig


@kernel
def fteso_step(
    z1: float, z2: float, z3: float, model: float, y: float, dt_s: float, w: float, alpha: float, scale: float,
    smooth: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Eqs. (3)-(4) over dt_s by an implicit step: the correction is evaluated at the error it leaves.

    model: g(x) u + f(x), m/s^2, mean over the step; y: the new measurement. Corrections are scale sig(e / scale)^p,
    rounded off below |e| = smooth scale. Unconditionally stable, and free of the chatter an explicit step of sig(e)
    shows near e = 0. After Acary and Brogliato, implicit sliding-mode discretisation (2010).
    """
    z1 = z1 + dt_s * z2 + 0.5 * dt_s * dt_s * (z3 + model)
    z2 = z2 + dt_s * (z3 + model)
    k1, k2, k3 = 3.0 * w * dt_s, 3.0 * w * w * dt_s * dt_s, w * w * w * dt_s * dt_s * dt_s
    p1, p2, p3 = 1.0 + alpha, 1.0 + 2.0 * alpha, 1.0 + 3.0 * alpha
    left = implicit_root((y - z1) / scale, k1, p1, k2, p2, k3, p3, smooth)
    third = k3 * sig(left, p3, smooth)
    second = k2 * sig(left, p2, smooth) + third
    return y - scale * left, z2 + scale * second / dt_s, z3 + scale * third / (dt_s * dt_s)


@kernel
def rate_step(x: float, rate: float, measured: float, dt_s: float, w: float, decay_1_s: float) -> tuple[float, float]:
    """Value and rate of a noisy signal: an alpha-beta filter with both poles at exp(-w dt), its rate decaying."""
    pole = exp(-w * dt_s)
    x = x + dt_s * rate
    missed = measured - x
    x = x + (1.0 - pole * pole) * missed
    rate = (rate + (1.0 - pole) * (1.0 - pole) / dt_s * missed) * exp(-decay_1_s * dt_s)
    return x, rate


@kernel
def wrapped(angle: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle + pi) % (2.0 * pi) - pi


@kernel
def extrapolation_error(times_s: Float, values: Float, t_s: float, y: float) -> tuple[float, float]:
    """How far y at t_s lies off the parabola through three earlier points, and its variance per unit of noise.

    Smooth motion cancels, whatever the spacing of the stamps; what is left is measurement noise.
    """
    error, gain = y, 1.0
    for i in range(3):
        weight = 1.0
        for j in range(3):
            if j != i:
                weight *= (t_s - times_s[j]) / (times_s[i] - times_s[j])
        error -= weight * values[i]
        gain += weight * weight
    return error, gain


@kernel
def activity(innovation: float, expected: float, most: float) -> float:
    """1 while the filtered innovation is no more than is expected of it, growing with it, at most `most`."""
    ratio = innovation / expected
    return min(sqrt(1.0 + ratio * ratio), most)
