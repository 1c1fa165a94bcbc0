"""What the emulated cameras make of true poses: mocap axes, marker frames, noise. One compiled call a frame."""

from formation.arrays import Bool, Float
from formation.kernel import kernel
from formation.quaternion import multiply_into, rotate_into, turn_into


@kernel
def look(
    truth: Float, looked_at: Bool, view: Float, q_flu_from_marker: Float, noise: Float, pos: Float, q: Float
) -> None:
    """Poses in the mocap's axes of the bodies looked at, into pos (n, 3) and q (n, 4).

    truth (n, 14): seconds since the truth was so, pos_lab_m, vel_lab_m_s, q_lab_from_flu, rate_flu_rad_s.
    view (7): q_mocap_from_lab and the mocap's origin in lab; q_flu_from_marker (n, 4); noise (n, 6): m, rad.
    """
    from_origin, turn, moved, seen = pos[0].copy(), pos[0].copy(), q[0].copy(), q[0].copy()
    for i in range(len(looked_at)):
        if not looked_at[i]:
            continue
        dt = truth[i, 0]
        for axis in range(3):
            from_origin[axis] = truth[i, 1 + axis] + dt * truth[i, 4 + axis] - view[4 + axis]
            turn[axis] = dt * truth[i, 11 + axis]
        rotate_into(view[:4], from_origin, pos[i])
        turn_into(truth[i, 7:11], turn, moved)
        multiply_into(view[:4], moved, seen)
        multiply_into(seen, q_flu_from_marker[i], moved)
        for axis in range(3):
            pos[i, axis] += noise[i, axis]
        turn_into(moved, noise[i, 3:], q[i])
