"""The translational part of geometric tracking control on SE(3) with integral action; one axis.

Lee, Leok, McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)" (CDC 2010), with the saturated
integral of Goodarzi, Lee, Lee, "Geometric nonlinear PID control of a quadrotor UAV on SE(3)" (ECC 2013). Its
attitude part lives where the gyroscope is: in the autopilot's attitude loop, which gets the attitude and the body
rates that this demand implies (formation.control.limits.attitude).
"""

from formation.maths.kernel import kernel


@kernel
def tracking_acceleration(
    e: float, e_rate: float, integral: float, kx: float, kv: float, ki: float, mix: float, bound: float, dt_s: float
) -> tuple[float, float]:
    """-kx e_x - kv e_v - ki sat(e_i), and the new e_i = integral of e_v + mix e_x, bounded to |e_i| <= bound."""
    integral = min(max(integral + dt_s * (e_rate + mix * e), -bound), bound)
    return -kx * e - kv * e_rate - ki * integral, integral
