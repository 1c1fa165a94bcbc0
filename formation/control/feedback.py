"""The one place where a law is chosen: error in, feedback acceleration out, for one axis of one vehicle."""

from math import sqrt

from formation.control.gains import AxisGains, CascadeGains, GeometricGains, Law, SlidingGains
from formation.control.geometric import tracking_acceleration
from formation.control.pid import velocity_error, velocity_pid
from formation.control.sliding_mode import (
    equivalent_and_reaching,
    sliding_variable,
    super_twisting,
    super_twisting_rate,
    switching,
)
from formation.maths.arrays import Float
from formation.maths.kernel import kernel

SMC, CFC, PID, GEOMETRIC = int(Law.SMC), int(Law.CFC), int(Law.PID), int(Law.GEOMETRIC)
SIDEWAYS_MOST_M_S2 = 11.7  # of gravity at a tilt of 50 degrees, the most that an agent follows
Feedback = tuple[float, float, float, float, float]
"""s, t_m, the law's new memory (z_m or integral), the feedback acceleration, and that acceleration's rate."""


@kernel
def uses_disturbance(gains: AxisGains) -> bool:
    """Whether the law subtracts the observer's Z3 (CFC), or fights disturbances by its own integral."""
    return gains.law == CFC


@kernel
def feedback(
    gains: AxisGains, e: float, e_rate: float, e_acc: float, memory: float, boost: float, speed_max: float, dt_s: float
) -> Feedback:
    """The feedback of an axis by its law, in the lead frame.

    e, e_rate, e_acc: relative error; boost: factor on p1. |e| is cut where closing it would ask for more than
    speed_max. The rate holds while errors evolve as predicted; it is what inverts the vehicle's first-order lag.
    """
    if gains.law == GEOMETRIC:
        return geometric_feedback(gains.geometric, e, e_rate, e_acc, memory, speed_max, dt_s)
    if gains.law == PID:
        return pid_feedback(gains.cascade, e, e_rate, e_acc, memory, speed_max, dt_s)
    return sliding_feedback(gains.sliding, e, e_rate, e_acc, memory, boost, speed_max, dt_s)


@kernel
def sliding_feedback(
    gains: SlidingGains, e: float, e_rate: float, e_acc: float, z_m: float, boost: float, speed_max: float, dt_s: float
) -> Feedback:
    """Eqs. (5)-(6), and of Eq. (7) -c e' - t_m; SMC: t_m = k sign(s)."""
    c, p1, p2, eps, smooth = gains.c, boost * gains.p1, gains.p2, gains.eps, gains.smooth_m_s
    e = bounded(e, speed_max / c)
    s = sliding_variable(c, e, e_rate)
    s_rate = sliding_variable(c, e_rate, e_acc)
    t_rate = 0.0
    if gains.law == SMC:
        t_m = switching(s, gains.k)
    else:
        t_m, z_m = super_twisting(s, z_m, p1, p2, eps, smooth, dt_s)
        if smooth > 0.0:
            t_rate = super_twisting_rate(s, s_rate, p1, p2, eps, smooth)
    return s, t_m, z_m, equivalent_and_reaching(c, e_rate, t_m), -c * e_acc - t_rate


@kernel
def pid_feedback(
    gains: CascadeGains, e: float, e_rate: float, e_acc: float, integral: float, speed_max: float, dt_s: float
) -> Feedback:
    """The cascade double-loop PID; its velocity error stands for s."""
    kp_position, kp, ki, kd = gains.kp_position, gains.kp, gains.ki, gains.kd
    e = bounded(e, speed_max / kp_position)
    s = velocity_error(kp_position, e, e_rate)
    s_rate = velocity_error(kp_position, e_rate, e_acc)
    acc, integral = velocity_pid(s, s_rate, integral, kp, ki, kd, dt_s)
    return s, -acc, integral, acc, -kp * s_rate - ki * s


@kernel
def geometric_feedback(
    gains: GeometricGains, e: float, e_rate: float, e_acc: float, integral: float, speed_max: float, dt_s: float
) -> Feedback:
    """The SE(3) controller's translational part; what its integral sums up stands for s."""
    kx, kv, ki, mix, bound = gains.kx, gains.kv, gains.ki, gains.mix, gains.bound
    e = bounded(e, speed_max * kv / kx)
    acc, integral = tracking_acceleration(e, e_rate, integral, kx, kv, ki, mix, bound, dt_s)
    s = mix * e + e_rate
    return s, -acc, integral, acc, -kx * e_rate - kv * e_acc - ki * s


@kernel
def bound_sideways(acc: Float) -> None:
    """Keeps a demand (3) within SIDEWAYS_MOST_M_S2 in place: the barriers that come after could not weigh more."""
    size = sqrt(acc[0] * acc[0] + acc[1] * acc[1])
    if size > SIDEWAYS_MOST_M_S2:
        acc[0] *= SIDEWAYS_MOST_M_S2 / size
        acc[1] *= SIDEWAYS_MOST_M_S2 / size


@kernel
def bounded(x: float, most: float) -> float:
    """x within [-most, most]."""
    return min(max(x, -most), most)
