"""What pushes a commanded vehicle, as its own accelerometer feels it: Z3 of the fast observer, before anything moves.

    miss = R (f - thrust along z) - bias - Z3_slow,  Z3_fast += gate (Z3_slow + miss - Z3_fast),  gate = r^4 / (1 + r^4)

along x and y of `lab`; f: specific force, mean over one step. Rotors pull along z alone, so what is felt across it is
somebody else's push, however well the thrust and the attitude's answer are modelled. r: the miss over what noise lets
it be, squared so that noise hardly opens the gate, and kept for a moment. Bias (the sensor's, and of how it lies
against the markers) and noise are learned while the gate is shut; the bias slowly while it is open, too, so that a
sensor that is wrong for good is believed for some seconds only. Where nothing is measured nothing is different.
"""

from math import exp

import numpy as np

from formation.estimation.parallel import open_gate
from formation.estimation.state import VehicleEstimate
from formation.maths.arrays import Float
from formation.maths.kernel import kernel
from formation.maths.quaternion import rotate_into

SIGMAS, HOLD_S = 4.5, 0.025
LEARNED_S, SLOWLY = 2.0, 0.25  # bias and noise; of that rate the bias, while the gate is open
NOISE_LEAST_M_S2, NOISE_MOST_M_S2 = 0.05, 1.5
PUSH_MOST_M_S2 = 14.0  # as much as Z3 may be


@kernel
def take_inertial(z: VehicleEstimate, q_before: Float, force_flu_m_s2: Float, dt_s: float) -> None:
    """Sets Z3 of the fast observer right by one step's specific force, before the observers take the step.

    q_before (4): attitude when the step began; force_flu_m_s2 (3): mean specific force over it, NaN where it was not
    measured.
    """
    z.inertial_ratio *= exp(-dt_s / HOLD_S)
    if not np.isfinite(force_flu_m_s2[0] + force_flu_m_s2[1] + force_flu_m_s2[2]):
        return
    across, first, last, miss = force_flu_m_s2.copy(), np.empty(3), np.empty(3), np.empty(2)
    across[2] -= z.thrust_scale * z.thrust_m_s2
    rotate_into(q_before, across, first)
    rotate_into(z.q_lab_from_flu, across, last)
    square = 0.0
    for axis in range(2):
        slow = z.dist_lab_m_s2[axis] - z.gate * z.spread[2, axis]
        push = 0.5 * (first[axis] + last[axis]) - z.inertial_bias_m_s2[axis]
        miss[axis] = min(max(push, -PUSH_MOST_M_S2), PUSH_MOST_M_S2) - slow
        square += miss[axis] * miss[axis]
    z.inertial_ratio = max(z.inertial_ratio, square / (SIGMAS * SIGMAS * z.inertial_var_m2_s4))
    gate = open_gate(z.inertial_ratio)
    share = 1.0 - exp(-dt_s / LEARNED_S)
    for axis in range(2):
        z.inertial_bias_m_s2[axis] += share * (1.0 - (1.0 - SLOWLY) * gate) * miss[axis]
        change = gate * (miss[axis] - z.spread[2, axis])
        z.spread[2, axis] += change
        z.dist_lab_m_s2[axis] += z.gate * change
    var = z.inertial_var_m2_s4 + (1.0 - gate) * share * (0.5 * square - z.inertial_var_m2_s4)
    z.inertial_var_m2_s4 = min(max(var, NOISE_LEAST_M_S2 * NOISE_LEAST_M_S2), NOISE_MOST_M_S2 * NOISE_MOST_M_S2)
