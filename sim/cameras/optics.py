"""What the emulated cameras make of true poses: mocap axes, marker frames, noise. One compiled call a frame."""

from formation.maths.arrays import Bool, Float
from formation.maths.kernel import kernel
from formation.maths.quaternion import multiply_into, rotate_into, turn_into


@kernel
def measure_poses(
    truth: Float, in_view: Bool, view: Float, q_flu_from_marker: Float, noise: Float, pos: Float, q: Float
) -> None:
    """Poses of the bodies in view, in the mocap's axes, into pos (n, 3) and q (n, 4).

    truth (n, 14): seconds since the truth was so, pos_lab_m, vel_lab_m_s, q_lab_from_flu, rate_flu_rad_s.
    view (7): q_mocap_from_lab and the mocap's origin in lab; q_flu_from_marker (n, 4).
    noise (n, 6): m in lab, rad in flu.
    """
    from_origin, turn, moved, seen = pos[0].copy(), pos[0].copy(), q[0].copy(), q[0].copy()
    for i in range(len(in_view)):
        if not in_view[i]:
            continue
        dt = truth[i, 0]
        for axis in range(3):
            from_origin[axis] = truth[i, 1 + axis] + dt * truth[i, 4 + axis] - view[4 + axis] + noise[i, axis]
            turn[axis] = dt * truth[i, 11 + axis]
        rotate_into(view[:4], from_origin, pos[i])
        turn_into(truth[i, 7:11], turn, moved)
        turn_into(moved, noise[i, 3:], seen)
        multiply_into(view[:4], seen, moved)
        multiply_into(moved, q_flu_from_marker[i], q[i])


@kernel
def blur(
    pos_mocap_m: Float, q_mocap_from_marker: Float, view: Float, q_flu_from_marker: Float, noise: Float,
    pos: Float, q: Float,
) -> None:  # fmt: skip
    """The same noise (6) on one body whose pose the mocap's axes have already, into pos (3) and q (4)."""
    shift, q_marker_from_flu, flu, turned = pos.copy(), q.copy(), q.copy(), q.copy()
    rotate_into(view[:4], noise[:3], shift)
    q_marker_from_flu[0] = q_flu_from_marker[0]
    for axis in range(3):
        pos[axis] = pos_mocap_m[axis] + shift[axis]
        q_marker_from_flu[axis + 1] = -q_flu_from_marker[axis + 1]
    multiply_into(q_mocap_from_marker, q_marker_from_flu, flu)
    turn_into(flu, noise[3:], turned)
    multiply_into(turned, q_flu_from_marker, q)
