"""What a quadcopter's jet does to another one below it. Nothing is compiled here; kernels take it from `rigid_body`.

Momentum theory: the air that a vehicle pushes down carries its thrust as momentum. Across, the jet is a Gaussian, at
first as wide as the vehicle, then wider as every turbulent jet. A vehicle below loses what of that momentum flows
through its own rotors. The two numbers are fitted to flights of two Crazyflies of 34 g and two of 67 g, and judged on
others (`python -m bench.downwash`, docs/evidence/2026-11-28-downwash.md).
"""

from math import exp

JET_WIDTH = 0.081
"""Of a round jet's Gaussian of speed, per distance from its nozzle, as Albertson et al. measured it (see
`drone_agent.simulation.disturbance`). Momentum goes with the speed squared: its Gaussian is narrower by the root of 2.
"""
FIRST_WIDTH = 1.22
"""Of the Gaussian of momentum at the vehicle itself, in reaches of its rotors (`rotor_reach_m`); fitted."""
CAUGHT = 0.96
"""Lift that a vehicle loses, over the momentum that flows through its rotors; fitted."""
EDGE = exp(-4.5)
"""Of the Gaussian at three sigmas, where the jet is taken to end."""


def jet_force_n(
    aside_m: float, below_m: float, thrust_n: float, upper_reach_m: float, reach_m: float, rotor_m: float
) -> float:
    """Force down on a vehicle in the jet of one above it; 0 beside it, above it and beyond the jet's edge.

    aside_m, below_m: of the vehicle from the upper one, horizontally and down; thrust_n: of the upper one; *reach_m: of
    the rotors along both horizontal axes; rotor_m: radius of the lower one's.
    """
    if below_m <= 0.0:
        return 0.0
    # The lower one's rotors stand `reach_m` off its middle: what they meet together is as much wider.
    wider_m = JET_WIDTH * below_m
    var_m2 = FIRST_WIDTH**2 * upper_reach_m**2 + 0.5 * wider_m**2 + reach_m**2
    off = aside_m * aside_m / var_m2
    if off >= 9.0:
        return 0.0
    through = 1.0 - exp(-2.0 * rotor_m * rotor_m / var_m2)  # four discs of pi rotor_m^2 in 2 pi var
    begun = min(below_m / upper_reach_m, 1.0)
    force_n: float = CAUGHT * thrust_n * through * begun * (exp(-0.5 * off) - EDGE) / (1.0 - EDGE)
    return force_n
