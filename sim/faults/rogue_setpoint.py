"""Setpoints as a ground that is wrong would send them: whole, in its name, and far beyond what it may ask for."""

import numpy as np

from formation.maths.frames import from_rotation_vector, multiply
from wire.link_messages import AttitudeSetpoint
from wire.mavlink.codec import Codec, read_frame
from wire.mavlink.framing import FrameCutter


def tilted(data: bytes, tilt_rad: float) -> bytes:
    """A datagram whose attitude targets are tilted so much farther, about the body's forward axis."""
    return b"".join(
        Codec(frame.source).encode(
            message._replace(
                q_lab_from_flu=multiply(message.q_lab_from_flu, from_rotation_vector(np.array([tilt_rad, 0.0, 0.0])))
            )
        )
        if isinstance(message := read_frame(frame).message, AttitudeSetpoint)
        else frame.data
        for frame in FrameCutter().cut(data)
    )
