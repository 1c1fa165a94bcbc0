"""A learned policy: the network of an ONNX file (onnx.ai), as most training frameworks export it, flies as a law.

It needs `pip install 'mavlink-formation[research]'`. Every vector is in the leader's frame (forward, left, up): that is
`lab` turned about z by the leader's heading. One input, float32 (1, 12):

    0..2   what the drone is off its slot, m        3..5    how that changes, m/s
    6..8   the slot's acceleration, m/s^2           9..11   the observer's disturbance, m/s^2

One output, float32 (1, 3): the acceleration demanded, m/s^2, gravity and drag excluded. All of it is predicted for the
moment when the command takes hold, as for every law. The network has no memory. `policy.onnx` beside this file is a
linear one, by hand: -12 m/s^2 a m, -6 m/s^2 a m/s, the slot's acceleration, less the disturbance.
"""

from functools import cache
from pathlib import Path

import numpy as np

from formation.maths import frames
from formation.maths.arrays import Float, Vec3
from formation.own_law.law import Situation

try:
    import onnxruntime
except ImportError as error:
    from mavlink_formation.installation import install_command

    raise ImportError(f"onnxruntime is not installed: {install_command('research')}") from error

BESIDE = Path(__file__).with_name("policy.onnx")


@cache
def network(file: str) -> "onnxruntime.InferenceSession":
    """The network of a file, loaded once, on this thread alone; ValueError where it cannot be flown."""
    if not Path(file).is_file():
        raise ValueError(f"{file}: no such file; the option `file` names the policy's ONNX file")
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        found = onnxruntime.InferenceSession(file, options, providers=["CPUExecutionProvider"])
        answer = answer_of(found, np.zeros((1, 12), np.float32))
    except Exception as error:  # onnxruntime's own kinds have no common base
        raise ValueError(f"{file}: no policy of one float32 input (1, 12): {error}") from error
    if answer.shape != (1, 3):
        raise ValueError(f"{file}: its output has the shape {answer.shape}: (1, 3) is wanted")
    return found


def answer_of(of: "onnxruntime.InferenceSession", asked: Float) -> Float:
    """Its first output."""
    (wanted,) = of.get_inputs()
    answer: Float = of.run(None, {wanted.name: asked})[0]
    return answer


class Policy:
    """file: the policy's ONNX file."""

    def __init__(self, file: str = str(BESIDE)) -> None:
        self._network = network(file)

    def __call__(self, at: Situation) -> Vec3:
        """The acceleration demanded in `lab`, m/s^2."""
        heading_rad = np.array(at.heading_rad)
        in_lab = np.stack([at.slot.acc_lab_m_s2, at.disturbance_lab_m_s2])
        asked = [at.error_lead_m, at.error_rate_lead_m_s, *frames.rotate_about_z(-heading_rad, in_lab)]
        answer = answer_of(self._network, np.concatenate(asked).astype(np.float32)[None])
        return frames.rotate_about_z(heading_rad, answer[0].astype(np.float64))
