"""The composite formation control law (CFC, Eq. 7)."""

from formation.maths.kernel import kernel


@kernel
def composite_acceleration(reference_acc: float, feedback_acc: float, z3: float) -> float:
    """Eq. (7): g(x) u + f(x) = lambda_d'' - c e' - t_m - Z3, one axis in `lab`.

    reference_acc: lambda_d'' as seen in `lab`; feedback_acc: -c e' - t_m, turned there; z3: Z3, the disturbance.
    """
    return reference_acc + feedback_acc - z3
