"""The sliding-mode laws of the paper, one axis at a time: SMC, ISTSMC and, with the observer's Z3, CFC (Eqs. 5-7)."""

from formation.maths.kernel import kernel
from formation.maths.powers import implicit_root, sig, sig_slope


@kernel
def sliding_variable(c: float, e: float, e_rate: float) -> float:
    """Eq. (5): s = c e + e'."""
    return c * e + e_rate


@kernel
def switching(s: float, k: float) -> float:
    """The baseline SMC's reaching law: t_m = k sign(s)."""
    return k if s > 0.0 else (-k if s < 0.0 else 0.0)


@kernel
def super_twisting(
    s: float, z_m: float, p1: float, p2: float, eps: float, smooth: float, dt_s: float
) -> tuple[float, float]:
    """Eq. (6) by an implicit step: t_m and the new z_m.

    t_m = p1 sig(s)^(1 + eps) + z_m, z_m' = p2 sig(s)^(1 + 2 eps), evaluated at the s that this very t_m leaves
    behind after dt_s (s' = -t_m): near s = 0 it lands on zero where an explicit step would chatter across it.
    smooth, m/s, rounds the powers off below that s; 0 is the paper's form. After Brogliato et al. (2020),
    implicit super-twisting.
    """
    p_outer, p_inner = 1.0 + eps, 1.0 + 2.0 * eps
    left = implicit_root(s - dt_s * z_m, dt_s * p1, p_outer, dt_s * dt_s * p2, p_inner, 0.0, 1.0, smooth)
    z_next = z_m + dt_s * p2 * sig(left, p_inner, smooth)
    return p1 * sig(left, p_outer, smooth) + z_next, z_next


@kernel
def super_twisting_rate(s: float, s_rate: float, p1: float, p2: float, eps: float, smooth: float) -> float:
    """t_m' of Eq. (6), for inverting the vehicle's lag; needs smooth > 0."""
    return p1 * sig_slope(s, 1.0 + eps, smooth) * s_rate + p2 * sig(s, 1.0 + 2.0 * eps, smooth)


@kernel
def equivalent_and_reaching(c: float, e_rate: float, t_m: float) -> float:
    """The error feedback inside Eq. (7): -c e' - t_m, in the lead frame."""
    return -c * e_rate - t_m
