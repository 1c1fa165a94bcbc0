"""A motion seen from the leader's rotating frame (Eq. 2) and back, with every term a yawing leader brings.

A motion is an array (3, 4): rows position, velocity, acceleration; columns x, y, z, heading. The frame's own motion
has the same layout: its origin, and the heading psi_L that turns it. A lab motion's frame is all zeros.
"""

from math import cos, sin

from formation.maths.arrays import Float
from formation.maths.kernel import kernel


@kernel
def copy_motion(source: Float, out: Float) -> None:
    """out (3, 4) becomes the source. (Spelt out: a slice assignment costs seconds of compilation.)"""
    for order in range(3):
        for column in range(4):
            out[order, column] = source[order, column]


@kernel
def lab_from_lead(motion_lead: Float, frame: Float, out: Float) -> None:
    """A motion given in the lead frame, as seen in `lab`, into out (3, 4).

    p = p_L + R lambda;  v = v_L + R (lambda' + W x lambda);
    a = a_L + R (lambda'' + 2 W x lambda' + W' x lambda + W x (W x lambda)),  W = psi_L' z:
    Coriolis, Euler and centripetal terms, in that order.
    """
    c, s = cos(frame[0, 3]), sin(frame[0, 3])
    w, alpha = frame[1, 3], frame[2, 3]
    x, y = motion_lead[0, 0], motion_lead[0, 1]
    vx, vy = motion_lead[1, 0], motion_lead[1, 1]
    ux, uy = vx - w * y, vy + w * x
    ax = motion_lead[2, 0] - 2.0 * w * vy - alpha * y - w * w * x
    ay = motion_lead[2, 1] + 2.0 * w * vx + alpha * x - w * w * y
    out[0, 0], out[0, 1] = frame[0, 0] + c * x - s * y, frame[0, 1] + s * x + c * y
    out[1, 0], out[1, 1] = frame[1, 0] + c * ux - s * uy, frame[1, 1] + s * ux + c * uy
    out[2, 0], out[2, 1] = frame[2, 0] + c * ax - s * ay, frame[2, 1] + s * ax + c * ay
    for order in range(3):
        out[order, 2] = frame[order, 2] + motion_lead[order, 2]
        out[order, 3] = frame[order, 3] + motion_lead[order, 3]


@kernel
def lead_from_lab(motion_lab: Float, frame: Float, out: Float) -> None:
    """Eq. (2) and its two derivatives: lambda, lambda', lambda'' of a lab motion, into out (3, 4)."""
    c, s = cos(frame[0, 3]), sin(frame[0, 3])
    w, alpha = frame[1, 3], frame[2, 3]
    for order in range(3):
        dx, dy = motion_lab[order, 0] - frame[order, 0], motion_lab[order, 1] - frame[order, 1]
        out[order, 0], out[order, 1] = c * dx + s * dy, -s * dx + c * dy
        out[order, 2] = motion_lab[order, 2] - frame[order, 2]
        out[order, 3] = motion_lab[order, 3] - frame[order, 3]
    out[1, 0] += w * out[0, 1]
    out[1, 1] -= w * out[0, 0]
    out[2, 0] += 2.0 * w * out[1, 1] + alpha * out[0, 1] + w * w * out[0, 0]
    out[2, 1] += -2.0 * w * out[1, 0] - alpha * out[0, 0] + w * w * out[0, 1]
