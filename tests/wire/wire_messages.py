"""Random link messages within what MAVLink can carry, and their comparison at its precision."""

import dataclasses
import math
from typing import Any

import numpy as np
from hypothesis import strategies as st

from formation import frames
from formation.messages import Severity
from wire import link_messages as lm

U8, U16, U32 = st.integers(0, 255), st.integers(0, 2**16 - 1), st.integers(0, 2**32 - 1)
I32, U64, I64 = st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**64 - 1), st.integers(-(2**63), 2**63 - 1)
METRES = st.floats(-1e3, 1e3, width=32)
FLOATS = st.floats(-1e6, 1e6, width=32)
ADDRESS = st.builds(lm.Address, U8, U8)
VECTOR = st.tuples(METRES, METRES, METRES).map(np.array)


@st.composite
def rotations(draw: st.DrawFn) -> np.ndarray:
    axis = np.array(draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3)))
    return frames.from_rotation_vector(axis * draw(st.floats(0.0, math.pi)))


def text(size: int) -> st.SearchStrategy[str]:
    characters = st.characters(exclude_categories=["Cs", "Cc"])
    return st.text(characters, max_size=size).filter(lambda s: len(s.encode()) <= size)


RAW = st.integers(0, 2**32 - 1).map(lambda n: n.to_bytes(4, "little"))
DEGREES = st.integers(-1_800_000_000, 1_800_000_000).map(lambda n: n * 1e-7)
MILLIMETRES = st.integers(-1_000_000, 1_000_000).map(lambda n: n * 1e-3)
SPEEDS = st.tuples(*[st.integers(-3000, 3000).map(lambda n: n * 0.01)] * 3).map(np.array)
PERCENT = st.integers(0, 100).map(lambda n: n * 0.01)
Q = rotations()

MESSAGES: dict[type, st.SearchStrategy[Any]] = {
    lm.Heartbeat: st.builds(lm.Heartbeat, st.sampled_from(lm.Autopilot), U8, U8, U32, U8),
    lm.AttitudeSetpoint: st.builds(lm.AttitudeSetpoint, ADDRESS, U32, Q, VECTOR, FLOATS, st.just(lm.Ignore.NONE)),
    lm.VisionPose: st.builds(lm.VisionPose, U64, VECTOR, Q),
    lm.MocapPose: st.builds(lm.MocapPose, U64, VECTOR, Q),
    lm.Odometry: st.builds(
        lm.Odometry,
        U64,
        st.sampled_from(lm.OdometryFrame),
        st.sampled_from(lm.EstimatorType),
        VECTOR,
        Q,
        VECTOR,
        VECTOR,
        U8,
    ),
    lm.Attitude: st.builds(lm.Attitude, U32, Q, VECTOR),
    lm.AttitudeQuaternion: st.builds(lm.AttitudeQuaternion, U32, Q, VECTOR),
    lm.LocalPosition: st.builds(lm.LocalPosition, U32, VECTOR, VECTOR),
    lm.GlobalPosition: st.builds(
        lm.GlobalPosition, U32, DEGREES, DEGREES, MILLIMETRES, MILLIMETRES, SPEEDS, st.none() | st.floats(-3.1, 3.1)
    ),
    lm.HomePosition: st.builds(lm.HomePosition, DEGREES, DEGREES, MILLIMETRES, VECTOR),
    lm.SysStatus: st.builds(lm.SysStatus, U32, U32, U32, PERCENT, st.floats(0, 60), st.floats(-300, 300), PERCENT),
    lm.Battery: st.builds(
        lm.Battery,
        st.lists(st.floats(0.1, 60), max_size=14).map(tuple),
        st.floats(0, 300),
        st.floats(0, 1e5),
        PERCENT,
    ),
    lm.ExtendedSysState: st.builds(lm.ExtendedSysState, st.sampled_from(lm.LandedState)),
    lm.EkfStatus: st.builds(lm.EkfStatus, U16, st.booleans()),
    lm.StatusText: st.builds(lm.StatusText, st.sampled_from(Severity), text(600)),
    lm.Command: st.builds(lm.Command, ADDRESS, U16, st.tuples(*[FLOATS] * 7), U8),
    lm.CommandInt: st.builds(lm.CommandInt, ADDRESS, U8, U16, st.tuples(*[FLOATS] * 4), I32, I32, FLOATS),
    lm.CommandAck: st.builds(lm.CommandAck, ADDRESS, U16, st.sampled_from(lm.Result), U8),
    lm.SetMode: st.builds(lm.SetMode, U8, U8, U32),
    lm.TimeSync: st.builds(lm.TimeSync, I64, I64, ADDRESS),
    lm.Ping: st.builds(lm.Ping, U64, U32, ADDRESS),
    lm.SystemTime: st.builds(lm.SystemTime, U64, U32),
    lm.ParamValue: st.builds(lm.ParamValue, text(16), RAW, st.sampled_from(lm.ParamType), U16, U16),
    lm.ParamSet: st.builds(lm.ParamSet, ADDRESS, text(16), RAW, st.sampled_from(lm.ParamType)),
    lm.ParamRequestRead: st.builds(lm.ParamRequestRead, ADDRESS, text(16), st.integers(-1, 2**15 - 1)),
    lm.ParamRequestList: st.builds(lm.ParamRequestList, ADDRESS),
    lm.AutopilotVersion: st.builds(lm.AutopilotVersion, U64, U32, U64),
    lm.AttitudeTargetReport: st.builds(lm.AttitudeTargetReport, U32, Q, VECTOR, FLOATS, st.just(lm.Ignore.NONE)),
    lm.SimTruth: st.builds(lm.SimTruth, U64, Q, SPEEDS, DEGREES, DEGREES, MILLIMETRES),
    lm.NamedValue: st.builds(lm.NamedValue, U32, text(10), FLOATS),
    lm.PositionSetpoint: st.builds(
        lm.PositionSetpoint,
        ADDRESS,
        U32,
        st.sampled_from(lm.LocalFrame),
        st.sampled_from(lm.PositionIgnore),
        VECTOR,
        VECTOR,
        VECTOR,
        st.floats(-3.0, 3.0, width=32),
        FLOATS,
    ),
    lm.SetOrigin: st.builds(lm.SetOrigin, U8, DEGREES, DEGREES, MILLIMETRES),
    lm.Origin: st.builds(lm.Origin, DEGREES, DEGREES, MILLIMETRES),
    lm.MessageInterval: st.builds(lm.MessageInterval, U16, I32),
    lm.MissionRequestList: st.builds(lm.MissionRequestList, ADDRESS, U8),
    lm.MissionCount: st.builds(lm.MissionCount, ADDRESS, U16, U8),
    lm.LogRequestList: st.builds(lm.LogRequestList, ADDRESS, U16, U16),
    lm.LogEntry: st.builds(lm.LogEntry, U16, U16, U16, U32, U32),
}
ANY_MESSAGE = st.one_of(*MESSAGES.values())

# The wire's own steps: quaternions and angles in floats, batteries in millivolts and centiamperes, headings in
# hundredths of a degree.
_TOLERANCE = {"cell_v": 5.1e-4, "battery_v": 5.1e-4, "battery_a": 5.1e-3, "current_a": 5.1e-3, "consumed_mah": 0.51}


def assert_same(ours: Any, theirs: Any) -> None:
    """Equal field by field, to the precision of the wire."""
    assert type(ours) is type(theirs)
    for field in dataclasses.fields(ours):
        a, b = getattr(ours, field.name), getattr(theirs, field.name)
        if field.name.startswith("q_"):
            assert_same_rotation(a, b)
        elif isinstance(a, float | tuple | np.ndarray):
            if field.name == "heading_rad":
                b = a + frames.wrap_angle(np.array(b - a))
            np.testing.assert_allclose(
                b, a, rtol=3e-7, atol=_TOLERANCE.get(field.name, 1e-4 if "heading" in field.name else 1e-6)
            )
        else:
            assert a == b, field.name


def assert_same_rotation(q: np.ndarray, other: np.ndarray) -> None:
    """The same rotation to 1e-6 rad or so, in canonical form."""
    assert other[0] >= 0.0
    np.testing.assert_allclose(np.linalg.norm(other), 1.0, atol=1e-12)
    # Euler angles in floats, near a pole, cost most: 1e-6 rad.
    assert min(np.abs(q - other).max(), np.abs(q + other).max()) < 1e-6
