"""The finite-time extended state observer of one axis (FTESO, Eqs. 3-4)."""

from formation.maths.kernel import kernel
from formation.maths.powers import implicit_root, sig


@kernel
def fteso_step(
    z1: float, z2: float, z3: float, model: float, y: float, dt_s: float, w: float, alpha: float, scale: float,
    smooth: float,
) -> tuple[float, float, float]:  # fmt: skip
    """Eqs. (3)-(4) over dt_s by an implicit step: the correction is evaluated at the error it leaves.

        e_o = y - Z1
        Z1' = Z2 + b1 sig(e_o)^(1+a)                      b1 = 3 w
        Z2' = Z3 + b2 sig(e_o)^(1+2a) + g(x) u + f(x)     b2 = 3 w^2
        Z3' =      b3 sig(e_o)^(1+3a)                     b3 = w^3

    model: g(x) u + f(x), m/s^2, mean over the step; y: the new measurement; alpha: a. Corrections are
    scale sig(e / scale)^p, rounded off below |e| = smooth scale. Unconditionally stable, and free of the chatter an
    explicit step of sig(e) shows near e = 0. After Acary and Brogliato, implicit sliding-mode discretisation (2010).
    """
    z1 = z1 + dt_s * z2 + 0.5 * dt_s * dt_s * (z3 + model)
    z2 = z2 + dt_s * (z3 + model)
    k1, k2, k3 = 3.0 * w * dt_s, 3.0 * w * w * dt_s * dt_s, w * w * w * dt_s * dt_s * dt_s
    p1, p2, p3 = 1.0 + alpha, 1.0 + 2.0 * alpha, 1.0 + 3.0 * alpha
    left = implicit_root((y - z1) / scale, k1, p1, k2, p2, k3, p3, smooth)
    third = k3 * sig(left, p3, smooth)
    second = k2 * sig(left, p2, smooth) + third
    return y - scale * left, z2 + scale * second / dt_s, z3 + scale * third / (dt_s * dt_s)
