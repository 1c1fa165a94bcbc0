"""The leader's cascade double-loop PID: position sets a velocity, velocity sets an acceleration; one axis."""

from formation.maths.kernel import kernel


@kernel
def velocity_error(kp_position: float, e: float, e_rate: float) -> float:
    """Outer loop: the velocity asked for is -kp e, relative to the reference's; what is missing of it, negated."""
    return e_rate + kp_position * e


@kernel
def velocity_pid(
    error: float, error_rate: float, integral: float, kp: float, ki: float, kd: float, dt_s: float
) -> tuple[float, float]:
    """Inner loop: acceleration -kp error - integral - kd error', and the new integral of ki error."""
    integral = integral + dt_s * ki * error
    return -kp * error - integral - kd * error_rate, integral
