"""The signed powers of finite-time control, and the one scalar equation their implicit time steps lead to."""

from math import exp, log

from formation.maths.kernel import kernel

NEWTON_STEPS = 40
NEWTON_TOLERANCE = 1e-13
LOG_LEAST = -700.0  # below it a double is zero for every purpose here


@kernel
def sig(x: float, power: float, smooth: float) -> float:
    """sig(x)^power = |x|^power sign(x), here x (x^2 + smooth^2)^((power - 1) / 2); smooth = 0 is the pure form.

    Continuous and odd; its slope at zero is finite for smooth > 0.
    """
    square = x * x + smooth * smooth
    if square == 0.0:
        return 0.0
    value: float = x * exp(0.5 * (power - 1.0) * log(square))
    return value


@kernel
def sig_slope(x: float, power: float, smooth: float) -> float:
    """d sig(x)^power / dx; only for smooth > 0 where x may vanish."""
    square = x * x + smooth * smooth
    if square == 0.0:
        return 0.0
    slope: float = exp(0.5 * (power - 3.0) * log(square)) * (smooth * smooth + power * x * x)
    return slope


@kernel
def implicit_root(y: float, k1: float, p1: float, k2: float, p2: float, k3: float, p3: float, smooth: float) -> float:
    """The x of x + k1 sig(x)^p1 + k2 sig(x)^p2 + k3 sig(x)^p3 = y, for k >= 0 and 0 < p <= 1.

    The left side rises strictly, so the root is unique and has y's sign. Newton in log x: there its slope
    stays between the least power and 1 whatever the scale, so it converges from anywhere.
    """
    size = abs(y)
    if size < 1e-300:
        return 0.0
    log_y = log(size)
    u = max(log_y - log(1.0 + k1 + k2 + k3), LOG_LEAST)
    for _ in range(NEWTON_STEPS):
        half_log, bend = u, 1.0
        if smooth > 0.0:
            square = exp(2.0 * u)
            half_log = 0.5 * log(square + smooth * smooth)
            bend = square / (square + smooth * smooth)
        a = k1 * exp((p1 - 1.0) * half_log)
        b = k2 * exp((p2 - 1.0) * half_log)
        c = k3 * exp((p3 - 1.0) * half_log) if k3 > 0.0 else 0.0
        total = 1.0 + a + b + c
        slope = (1.0 + a * (1.0 + (p1 - 1.0) * bend) + b * (1.0 + (p2 - 1.0) * bend)
                 + c * (1.0 + (p3 - 1.0) * bend)) / total  # fmt: skip
        step = (u + log(total) - log_y) / slope
        u = max(u - step, LOG_LEAST)
        if abs(step) < NEWTON_TOLERANCE:
            break
    root = exp(u)
    return root if y > 0.0 else -root
