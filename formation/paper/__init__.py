"""The equations of the paper, a file each; `formation.control.law` applies them to all vehicles.

Eq. (2): a motion in the leader's frame. Eqs. (3)-(4): the finite-time extended state observer. Eqs. (5)-(6): the
sliding variable and the super-twisting law. Eq. (7): the composite law. Eq. (1): `formation.vehicle.rigid_body`.
"""
