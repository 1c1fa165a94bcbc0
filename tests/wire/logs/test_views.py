"""What viewers are shown, read by the mcap library and Protobuf's own descriptors."""

import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

from formation import messages as m
from formation import topics
from formation.clock_pair import ClockPair
from formation.config import Fence, FollowerConfig, LabConfig, LeaderConfig, LimitsConfig
from tests.wire.flight import check_log
from wire.link_messages import (
    Address,
    Battery,
    ExtendedSysState,
    Heartbeat,
    LandedState,
    MavAutopilot,
    NamedValue,
    StatusText,
)
from wire.logs.mcap_read import read_log
from wire.logs.mcap_write import LogWriter
from wire.mavlink.codec import Codec
from wire.schema import schema_of

START = ClockPair(1_000_000_000, 1_790_000_000_000_000_000)
LAB = LabConfig(
    leader=LeaderConfig(body="wand"),
    followers=(
        FollowerConfig(body="left", sysid=2, offset_m=(-1.0, 0.5, 0.0)),
        FollowerConfig(body="right", sysid=3, offset_m=(-1.0, -0.5, 0.0)),
    ),
    limits=LimitsConfig(fence=Fence(low_m=(-2.0, -3.0, -0.1), high_m=(2.0, 3.0, 2.5))),
)
HALF = math.sqrt(0.5)
UNIT = np.array([1.0, 0.0, 0.0, 0.0])
NOSE_UP, LEFT_ABOUT = np.array([math.cos(0.1), 0.0, -math.sin(0.1), 0.0]), np.array([HALF, 0.0, 0.0, HALF])
Q = np.stack([UNIT, NOSE_UP, LEFT_ABOUT])


def of(first: float, rows: int = 3) -> np.ndarray:
    return first + np.arange(3.0 * rows).reshape(rows, 3) / 8.0  # floats hold eighths


def frame(seq: int, t_ns: int) -> m.LabFrame:
    return m.LabFrame(seq, t_ns, ("wand", "left", "right"), of(1.0 + seq), Q, np.array([True, True, seq % 2 == 0]))


def control(t_ns: int) -> list[tuple[topics.Topic, object]]:
    """Followers in a frame at (5, 6, 0) that looks along lab y, their slots a metre ahead and at its left."""
    flat, none, two = np.zeros(3), np.zeros((2, 3)), np.zeros(2)
    age_s = np.array([0.0, 0.25, 0.5])
    slot = np.array([[1.0, 0.0, 2.0], [0.0, 1.0, 2.0]])
    state = m.SwarmState(t_ns, of(1.0), of(2.0), of(3.0), of(4.0), Q, flat, flat, flat, age_s, flat)
    origin, heading = np.array([[5.0, 6.0, 0.0]] * 2), np.full(2, math.pi / 2.0)
    reference = m.Reference(t_ns, origin, none, none, heading, two, two, slot, none, none, two, two, np.ones(2, bool))
    command = m.Command(t_ns, of(0.5, 2), none, none, none, none, none, of(0.25, 2), two, two)
    target = m.AttitudeTarget(t_ns, Q[1:], none, np.array([0.5, 0.75]), two, np.zeros(2, np.bool_))
    return [
        (topics.STATE, state), (topics.REFERENCE, reference), (topics.COMMAND, command), (topics.TARGET, target)
    ]  # fmt: skip


def said(sysid: int) -> list[m.Datagram]:
    codec = Codec(Address(sysid, 1))
    packets = [
        codec.encode(message)
        for message in (
            Heartbeat(MavAutopilot.PX4, 2, 128, 393216, 4),
            StatusText(m.Severity.INFO, "hello"),
            Battery((3.75, 3.75), 1.0, 10.0, 0.5),
            ExtendedSysState(LandedState.IN_AIR),
            NamedValue(0, "age_ms", 12.5),
        )
    ]
    return [m.Datagram(sysid, data) for k, data in enumerate(packets) if k != 1]  # the text is lost on the way


@pytest.fixture(scope="module")
def shown(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[int, Any]]]:
    """Two seconds on the ground and two in flight: (log time, message) by topic."""
    path = tmp_path_factory.mktemp("views") / "flight.mcap"
    with LogWriter(path, {"lab": LAB.model_dump_json()}, start=START, threaded=False) as log:
        log.write(topics.PHASE, m.PhaseChange(m.Phase.GROUND), START.monotonic_ns)
        for seq in range(400):
            t_ns = START.monotonic_ns + seq * 10_000_000
            if seq == 200:
                log.write(topics.PHASE, m.PhaseChange(m.Phase.TAKEOFF), t_ns)
                log.write(topics.EVENT, m.Event(m.Severity.WARNING, "left", "battery low"), t_ns)
                for datagram in said(2):
                    log.write(topics.LINK_UP, datagram, t_ns)
            log.write(topics.MOCAP, frame(seq, t_ns), t_ns)
            log.write(topics.TICK, m.Tick(t_ns), t_ns)
            for topic, message in control(t_ns):
                log.write(topic, message, t_ns)
    assert check_log(path).complete
    return viewed(path)


def viewed(path: Path) -> dict[str, list[tuple[int, Any]]]:
    seen: dict[str, list[tuple[int, Any]]] = defaultdict(list)
    with path.open("rb") as file:
        for _, channel, message, proto in make_reader(
            file, decoder_factories=[DecoderFactory()]
        ).iter_decoded_messages():
            seen[channel.topic].append((message.log_time, proto))
    return seen


def test_each_drone_has_a_state_of_its_own_with_named_fields(shown) -> None:
    _, left = shown["/drone/left/state"][-1]
    assert (left.pos.x, left.pos.y, left.pos.z) == tuple(of(1.0)[1])
    assert (left.vel.y, left.dist.z, left.err.x, left.acc.y) == (of(2.0)[1, 1], of(3.0)[1, 2], 0.5, 0.375)
    assert (left.thrust, left.age_s) == (0.5, 0.25)
    assert (left.att.roll, left.att.pitch, left.att.yaw) == pytest.approx((0.0, -0.2, 0.0), abs=1e-6)
    assert (left.ref.x, left.ref.y, left.ref.z) == pytest.approx((5.0, 7.0, 2.0), abs=1e-6)
    _, right = shown["/drone/right/state"][-1]
    assert right.att.yaw == pytest.approx(math.pi / 2.0)
    assert (right.ref.x, right.ref.y) == pytest.approx((4.0, 6.0), abs=1e-6)
    assert right.thrust == 0.75
    _, wand = shown["/drone/wand/state"][-1]
    assert wand.pos.x == 1.0
    assert not wand.HasField("ref")
    assert not wand.HasField("err")


def test_the_file_knows_the_date_and_the_reader_the_stamp(shown, tmp_path: Path) -> None:
    assert shown["mocap/frame"][0][0] == START.unix_ns
    assert shown["/drone/left/state"][-1][0] == START.unix_ns + 3_960_000_000
    _, tf = shown["/tf"][0]
    assert tf.transforms[0].timestamp.seconds == 1_790_000_000
    path = tmp_path / "flight.mcap"
    with LogWriter(path, {}, start=START, threaded=False) as log:
        log.write(topics.TICK, m.Tick(7), 1_000_000_007)
    assert [entry.t_ns for entry in read_log(path).entries] == [1_000_000_007]
    assert read_log(path).metadata["date"] == "2026-09-21T14:13:20Z"


def test_on_the_ground_ten_a_second_is_shown_in_flight_more(shown) -> None:
    def hz(topic: str, since_s: float, until_s: float) -> float:
        times = [(t_ns - START.unix_ns) * 1e-9 for t_ns, _ in shown[topic]]
        return sum(since_s <= t_s < until_s for t_s in times) / (until_s - since_s)

    assert hz("/drone/left/state", 0.0, 2.0) == 10.0
    assert hz("/drone/left/state", 2.0, 4.0) == pytest.approx(1.0 / 0.07, abs=0.5)
    assert hz("/drone/left/link", 0.0, 4.0) == 1.0
    assert hz("mocap/frame", 0.0, 4.0) == 100.0


def test_battery_link_and_mode_are_what_the_drone_said(shown) -> None:
    t_ns, link = shown["/drone/left/link"][-1]
    assert (link.battery_v, link.battery, link.setpoint_age_ms) == (7.5, 0.5, 12.5)
    assert (link.armed, link.landed, link.custom_mode) == (True, LandedState.IN_AIR, 393216)
    assert (link.received, link.lost) == (4, 1)
    assert link.silent_s == pytest.approx((t_ns - START.unix_ns) * 1e-9 - 2.0)
    _, right = shown["/drone/right/link"][-1]
    assert math.isnan(right.battery_v)
    assert right.received == 0


def test_the_scene_has_fence_drones_slots_and_trails(shown) -> None:
    _, scene = shown["/scene"][0]
    entities = {entity.id: entity for entity in scene.entities}
    assert set(entities) == {"fence", "drone/wand", "drone/left", "drone/right", "slot/left", "slot/right"}
    corners = {(p.x, p.y, p.z) for p in entities["fence"].lines[0].points}
    assert len(entities["fence"].lines[0].points) == 24
    assert corners == {(x, y, z) for x in (-2.0, 2.0) for y in (-3.0, 3.0) for z in (-0.1, 2.5)}
    assert entities["drone/left"].frame_id == "left"
    assert entities["slot/left"].frame_id == "slot/left"
    assert entities["drone/left"].texts[0].text == "left"
    trails = [entity for _, update in shown["/scene/trails"] for entity in update.entities]
    assert {entity.frame_id for entity in trails} == {"lab"}
    assert all(entity.lifetime.seconds == 10 for entity in trails)
    assert len({entity.id for entity in trails}) == len(trails)


def test_frames_are_those_of_bodies_that_are_seen_and_of_slots(shown) -> None:
    told = [transform for _, update in shown["/tf"] for transform in update.transforms]
    assert {(t.parent_frame_id, t.child_frame_id) for t in told} == {
        ("lab", name) for name in ("wand", "left", "right", "slot/left", "slot/right")
    }
    odd = [t for _, u in shown["/tf"] for t in u.transforms if t.translation.x == 1.0 + 201 + 3.0 / 8.0]
    assert [t.child_frame_id for t in odd] in (["left"], [])
    slot = [t for t in told if t.child_frame_id == "slot/left"][-1]
    assert (slot.translation.x, slot.translation.y) == pytest.approx((5.0, 7.0))


def test_an_event_is_a_line_of_the_log(shown) -> None:
    (t_ns, line), *_ = shown["/log"]
    assert (line.name, line.message, line.level) == ("left", "battery low", 3)
    assert t_ns == START.unix_ns + 2_000_000_000


def test_a_log_without_a_date_gives_its_stamps_as_they_are(tmp_path: Path) -> None:
    """Those of before: their times were the monotonic clock's own."""
    path = tmp_path / "old.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_metadata("run", {"seed": "1"})
        schema = schema_of(m.Tick)
        number = writer.register_schema(schema.name, "protobuf", schema.descriptor_set)
        channel = writer.register_channel(topics.TICK.name, "protobuf", number)
        writer.add_message(channel, 7, schema.encode(m.Tick(7)), 7)
        writer.finish()
    assert [(entry.t_ns, entry.message) for entry in read_log(path).entries] == [(7, m.Tick(7))]
    assert check_log(path).complete
