"""Random link messages within what MAVLink can carry, and their comparison at its precision."""

import inspect
import math
from typing import Any

import numpy as np
from hypothesis import strategies as st

from formation.maths import frames
from formation.messages import Severity
from wire.link_messages import (
    Address,
    Attitude,
    AttitudeQuaternion,
    AttitudeSetpoint,
    AttitudeTargetReport,
    AutopilotVersion,
    Battery,
    CommandAck,
    CommandInt,
    CommandLong,
    EkfStatus,
    EstimatorType,
    ExtendedSysState,
    GlobalPosition,
    Heartbeat,
    HomePosition,
    Ignore,
    InertialSample,
    LandedState,
    LocalFrame,
    LocalPosition,
    LogEntry,
    LogRequestList,
    MavAutopilot,
    MessageInterval,
    MissionCount,
    MissionRequestList,
    MocapPose,
    NamedValue,
    Odometry,
    OdometryFrame,
    Origin,
    Packet,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamType,
    ParamValue,
    Ping,
    PositionIgnore,
    PositionSetpoint,
    Result,
    SetMode,
    SetOrigin,
    SimTruth,
    StatusText,
    SysStatus,
    SystemTime,
    TimeSync,
    VisionPose,
)
from wire.mavlink.codec import read_message
from wire.mavlink.framing import FrameCutter, MavlinkError
from wire.mavlink.text import TextChunk, text_of

U8, U16, U32 = st.integers(0, 255), st.integers(0, 2**16 - 1), st.integers(0, 2**32 - 1)
I32, U64, I64 = st.integers(-(2**31), 2**31 - 1), st.integers(0, 2**64 - 1), st.integers(-(2**63), 2**63 - 1)
METRES = st.floats(-1e3, 1e3, width=32)
FLOATS = st.floats(-1e6, 1e6, width=32)
ADDRESS = st.builds(Address, U8, U8)
VECTOR = st.tuples(METRES, METRES, METRES).map(np.array)


@st.composite
def rotations(draw: st.DrawFn) -> np.ndarray:
    axis = np.array(draw(st.tuples(*[st.floats(-1.0, 1.0)] * 3)))
    return frames.from_rotation_vector(axis * draw(st.floats(0.0, math.pi)))


def text(size: int) -> st.SearchStrategy[str]:
    """What is printed as it was sent; the rest is taken out on the way in."""
    characters = st.characters(exclude_categories=["C", "Z"], include_characters=" ")
    return st.text(characters, max_size=size).filter(lambda s: len(s.encode()) <= size and s.isprintable())


PARAM_NAME = st.from_regex(r"[A-Za-z0-9_]{1,16}", fullmatch=True)
RAW = st.integers(0, 2**32 - 1).map(lambda n: n.to_bytes(4, "little"))
DEGREES = st.integers(-1_800_000_000, 1_800_000_000).map(lambda n: n * 1e-7)
MILLIMETRES = st.integers(-1_000_000, 1_000_000).map(lambda n: n * 1e-3)
SPEEDS = st.tuples(*[st.integers(-3000, 3000).map(lambda n: n * 0.01)] * 3).map(np.array)
PERCENT = st.integers(0, 100).map(lambda n: n * 0.01)
Q = rotations()

MESSAGES: dict[type, st.SearchStrategy[Any]] = {
    Heartbeat: st.builds(Heartbeat, st.sampled_from(MavAutopilot), U8, U8, U32, U8),
    AttitudeSetpoint: st.builds(AttitudeSetpoint, ADDRESS, U32, Q, VECTOR, FLOATS, st.just(Ignore.NONE)),
    VisionPose: st.builds(VisionPose, U64, VECTOR, Q),
    MocapPose: st.builds(MocapPose, U64, VECTOR, Q),
    Odometry: st.builds(
        Odometry,
        U64,
        st.sampled_from(OdometryFrame),
        st.sampled_from(EstimatorType),
        VECTOR,
        Q,
        VECTOR,
        VECTOR,
        U8,
    ),
    Attitude: st.builds(Attitude, U32, Q, VECTOR),
    AttitudeQuaternion: st.builds(AttitudeQuaternion, U32, Q, VECTOR),
    InertialSample: st.builds(InertialSample, U64, VECTOR, VECTOR),
    LocalPosition: st.builds(LocalPosition, U32, VECTOR, VECTOR),
    GlobalPosition: st.builds(
        GlobalPosition, U32, DEGREES, DEGREES, MILLIMETRES, MILLIMETRES, SPEEDS, st.none() | st.floats(-3.1, 3.1)
    ),
    HomePosition: st.builds(HomePosition, DEGREES, DEGREES, MILLIMETRES, VECTOR),
    SysStatus: st.builds(SysStatus, U32, U32, U32, PERCENT, st.floats(0, 60), st.floats(-300, 300), PERCENT, PERCENT),
    Battery: st.builds(
        Battery,
        st.lists(st.floats(0.1, 60), max_size=14).map(tuple),
        st.floats(0, 300),
        st.floats(0, 1e5),
        PERCENT,
    ),
    ExtendedSysState: st.builds(ExtendedSysState, st.sampled_from(LandedState)),
    EkfStatus: st.one_of(
        st.builds(EkfStatus, U16, st.just(True), *[st.just(0)] * 5),
        st.builds(EkfStatus, U16, st.just(False), U64, *[FLOATS] * 4),
    ),
    StatusText: st.builds(StatusText, st.sampled_from(Severity), text(600)),
    CommandLong: st.builds(CommandLong, ADDRESS, U16, st.tuples(*[FLOATS] * 7), U8),
    CommandInt: st.builds(CommandInt, ADDRESS, U8, U16, st.tuples(*[FLOATS] * 4), I32, I32, FLOATS),
    CommandAck: st.builds(CommandAck, ADDRESS, U16, st.sampled_from(Result), U8),
    SetMode: st.builds(SetMode, U8, U8, U32),
    TimeSync: st.builds(TimeSync, I64, I64, ADDRESS),
    Ping: st.builds(Ping, U64, U32, ADDRESS),
    SystemTime: st.builds(SystemTime, U64, U32),
    ParamValue: st.builds(ParamValue, PARAM_NAME, RAW, st.sampled_from(ParamType), U16, U16),
    ParamSet: st.builds(ParamSet, ADDRESS, text(16), RAW, st.sampled_from(ParamType)),
    ParamRequestRead: st.builds(ParamRequestRead, ADDRESS, text(16), st.integers(-1, 2**15 - 1)),
    ParamRequestList: st.builds(ParamRequestList, ADDRESS),
    AutopilotVersion: st.builds(AutopilotVersion, U64, U32, U64),
    AttitudeTargetReport: st.builds(AttitudeTargetReport, U32, Q, VECTOR, FLOATS, st.just(Ignore.NONE)),
    SimTruth: st.builds(SimTruth, U64, Q, SPEEDS, DEGREES, DEGREES, MILLIMETRES),
    NamedValue: st.builds(NamedValue, U32, text(10), FLOATS),
    PositionSetpoint: st.builds(
        PositionSetpoint,
        ADDRESS,
        U32,
        st.sampled_from(LocalFrame),
        st.sampled_from(PositionIgnore),
        VECTOR,
        VECTOR,
        VECTOR,
        st.floats(-3.0, 3.0, width=32),
        FLOATS,
    ),
    SetOrigin: st.builds(SetOrigin, U8, DEGREES, DEGREES, MILLIMETRES),
    Origin: st.builds(Origin, DEGREES, DEGREES, MILLIMETRES),
    MessageInterval: st.builds(MessageInterval, U16, I32),
    MissionRequestList: st.builds(MissionRequestList, ADDRESS, U8),
    MissionCount: st.builds(MissionCount, ADDRESS, U16, U8),
    LogRequestList: st.builds(LogRequestList, ADDRESS, U16, U16),
    LogEntry: st.builds(LogEntry, U16, U16, U16, U32, U32),
}
ANY_MESSAGE = st.one_of(*MESSAGES.values())

# The wire's own steps: quaternions and angles in floats, batteries in millivolts and centiamperes, headings in
# hundredths of a degree.
_TOLERANCE = {"cell_v": 5.1e-4, "battery_v": 5.1e-4, "battery_a": 5.1e-3, "current_a": 5.1e-3, "consumed_mah": 0.51}


def assert_same(ours: Any, theirs: Any) -> None:
    """Equal field by field, to the precision of the wire."""
    assert type(ours) is type(theirs)
    for name in inspect.signature(type(ours)).parameters:
        a, b = getattr(ours, name), getattr(theirs, name)
        if name.startswith("q_"):
            assert_same_rotation(a, b)
        elif isinstance(a, float | tuple | np.ndarray):
            if name == "heading_rad":
                b = a + frames.wrap_angle(np.array(b - a))
            np.testing.assert_allclose(b, a, rtol=3e-7, atol=_TOLERANCE.get(name, 1e-4 if "heading" in name else 1e-6))
        else:
            assert a == b, name


def assert_same_rotation(q: np.ndarray, other: np.ndarray) -> None:
    """The same rotation to 1e-6 rad or so, in canonical form."""
    assert other[0] >= 0.0
    np.testing.assert_allclose(np.linalg.norm(other), 1.0, atol=1e-12)
    # Euler angles in floats, near a pole, cost most: 1e-6 rad.
    assert min(np.abs(q - other).max(), np.abs(q + other).max()) < 1e-6


def decode_packet(data: bytes) -> Packet:
    """The packet that `data` is, whole and alone; MavlinkError if it is none."""
    frames = FrameCutter().cut(data)
    if [frame.data for frame in frames] != [data]:
        raise MavlinkError("not one whole MAVLink packet with its checksum")
    message = read_message(frames[0])
    if isinstance(message, TextChunk):
        message = text_of(message.severity, [message.part])
    return Packet(frames[0].source, frames[0].seq, message)
