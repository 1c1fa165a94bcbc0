"""Where poses come from, as a lab file may say it."""

import itertools

import numpy as np
import pytest
from pydantic import ValidationError

from formation.maths import frames
from formation.mocap_config import MocapConfig, rotation_of

POINTING = {
    "forward": (1.0, 0.0, 0.0), "back": (-1.0, 0.0, 0.0), "left": (0.0, 1.0, 0.0),
    "right": (0.0, -1.0, 0.0), "up": (0.0, 0.0, 1.0), "down": (0.0, 0.0, -1.0),
}  # fmt: skip


def test_every_right_handed_set_of_axes_is_its_rotation_and_no_other_is_taken() -> None:
    right_handed = 0
    for x, y, z in itertools.product(POINTING, repeat=3):
        columns = np.array([POINTING[x], POINTING[y], POINTING[z]]).T
        axes = (f"z {z}", f"x {x}", f"y {y}")
        if np.isclose(np.linalg.det(columns), 1.0):
            right_handed += 1
            q = np.array(rotation_of(axes))
            np.testing.assert_allclose(frames.matrix(q), columns, atol=1e-15)
            assert q[0] >= 0.0
        else:
            with pytest.raises(ValueError, match="right-handed"):
                rotation_of(axes)
    assert right_handed == 24


def test_the_y_up_cameras_of_a_lab_are_written_in_words() -> None:
    mocap = MocapConfig.model_validate({"axes": ["x forward", "y up", "z right"]})
    assert mocap.q_lab_from_mocap == pytest.approx((0.5**0.5, 0.5**0.5, 0.0, 0.0))
    again = MocapConfig.model_validate(mocap.model_dump())
    assert again == mocap


@pytest.mark.parametrize(("values", "why"), [
    ({"axes": ["x forward", "y up"]}, "three"),
    ({"axes": ["x forward", "y up", "y right"]}, "once each"),
    ({"axes": ["x ahead", "y up", "z right"]}, "x ahead"),
    ({"axes": ["x forward", "y up", "z right"], "q_lab_from_mocap": [1.0, 0.0, 0.0, 0.0]}, "says another rotation"),
    ({"unit": "mm"}, "metres"),
    ({"source": "ros2", "unit": "cm"}, "metres"),
    ({"source": "mavlink"}, "examples/sitl_poses.py"),
    ({"source": "vrpn", "vrpn": {"assemble_s": 0.002}}, "write mocap.assemble_s"),
    ({"source": "ros2", "ros2": {"repeats_are_lost": False}}, "write mocap.repeats_are_lost"),
    ({"source": "chingmu", "chingmu": {"first_sensor": 1}}, "mocap.names"),
    ({"unit": "feet"}, "'m', 'cm' or 'mm'"),
    ({"source": "vrpn", "names": {"A": "left", "B": "left"}}, "two names"),
    ({"source": "vrpn", "vrpn": {"port": 0}}, "greater"),
    ({"source": "natnet", "natnet": {"host": "no host"}}, "host"),
])  # fmt: skip
def test_what_cannot_be_meant_is_refused(values: dict[str, object], why: str) -> None:
    with pytest.raises(ValidationError, match=why):
        MocapConfig.model_validate(values)


@pytest.mark.parametrize(("source", "unit", "unit_m"), [
    ("vrpn", None, 1.0), ("vrpn", "mm", 0.001), ("natnet", None, 1.0), ("natnet", "cm", 0.01),
    ("chingmu", None, 0.001), ("nokov", None, 1.0), ("qualisys", None, 0.001),
    ("vicon", None, 0.001), ("chingmu", "m", 1.0),
])  # fmt: skip
def test_units_are_the_systems_own_unless_the_file_says_otherwise(source: str, unit: str | None, unit_m: float) -> None:
    assert MocapConfig.model_validate({"source": source, "unit": unit}).unit_m == unit_m


def test_the_constant_latency_is_the_whole_delay_where_none_is_given() -> None:
    assert MocapConfig(delay_s=0.011).constant_latency_s == 0.011
    assert MocapConfig(delay_s=0.011, latency_s=0.004).constant_latency_s == 0.004
