"""What `gcs ros2` publishes of what comes over the bus; and the whole of it between a lab's bus and a ROS graph."""

import asyncio
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from formation import topics
from formation.clock_pair import ClockPair
from formation.codes import Cause, Phase, Severity
from formation.config import LabConfig
from formation.messages import LabFrame, OperatorReply, OperatorRequest, Verb
from gcs.ros2 import Shows, run
from tests.analysis.synthetic_flight import LAB, METADATA, T0_NS, Recipe, records
from tests.gcs.bus import a_lab, hub_of
from tests.gcs.test_live import HEAD, FakeBus
from tests.wire.ros2.peers import DOMAIN, POSE, call, opened, router
from wire.clock import REAL_TIME
from wire.ground_state import Alarm, Counters, DroneState, GroundState, encode
from wire.logs.live import sharer
from wire.logs.mcap_write import LogWriter
from wire.ros2.flight import Flight
from wire.ros2.message_types import Values, message_type
from wire.ros2.node import Graph
from wire.security.protection import LOOPBACK_ONLY
from wire.transport.mocap_bus import MocapBus

START = ClockPair(T0_NS, 1_790_000_000_000_000_000)


class Kept:
    """A publisher that keeps what it is given."""

    def __init__(self, has_subscribers: bool = True) -> None:
        self.has_subscribers = has_subscribers
        self.sent: list[Values] = []

    def publish(self, values: Values) -> None:
        self.sent.append(values)


def shows(heard: bool = True) -> tuple[Shows, dict[str, Kept]]:
    flight = Flight(LAB)
    publishers = {topic: Kept(heard) for topic in flight.types}
    shown = Shows(flight, REAL_TIME)
    shown.publishers = publishers
    return shown, publishers


def shared(path: Path) -> Iterator[tuple[str, bytes]]:
    """A flight's log as its ground shares it."""
    bus = FakeBus(heard=True)
    with LogWriter(path, METADATA, start=START, threaded=False, share=sharer(bus, "main")) as log:
        for record in sorted(records(Recipe()), key=lambda r: r.t_ns):
            log.write(record.topic, record.message, record.t_ns)
    yield from bus.sent


def state(**changes: object) -> GroundState:
    drone = DroneState(
        2, "left", "PX4", True, None, "OFFBOARD", "", False, "IN_AIR", None, None, None, None, None, None, None, 0.1,
        0.8, 11.4, None, 0, None, None, 0.0, None,
    )  # fmt: skip
    return GroundState(
        phase=Phase.HOLD, cause="operator", cause_code=Cause.OPERATOR, t_s=1.0, phase_s=1.0, ground_session=1,
        log_trouble="", button_trouble="", armed=True, not_landed=(), open_alarms=(), allowed={}, reject_codes={},
        trajectory_started=False, trajectory_done=False, trajectory_s=None, trajectory_from=None, landing_left_s=None,
        shape="configured", slots_lead_m=(), drones=(drone,), observed=(), leader_yaw_rad=None, rejected={},
        prearm_failures=(), counters=Counters(*(0,) * 10), **changes,
    )  # fmt: skip


def test_estimate_target_and_error_of_each_chunk_s_end_are_published_at_their_own_stamps(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("wire.logs.mcap_write._CHUNK_MESSAGES", 1)  # each is the last one of its chunk
    shown, publishers = shows()
    for key, payload in shared(tmp_path / "flight.mcap"):
        (shown.receive_head if key == HEAD else shown.receive_chunk)(payload)
    logged = sorted(records(Recipe()), key=lambda r: r.t_ns)
    for topic, kind in (
        ("right/odom", topics.STATE),
        ("right/target", topics.REFERENCE),
        ("left/formation_error", topics.COMMAND),
    ):
        stamps = [values[0] * 10**9 + values[1] for values in publishers[topic].sent]
        assert stamps == [record.message.t_ns + START.ahead_ns for record in logged if record.topic is kind]
        message_type(Flight(LAB).types[topic]).encode(publishers[topic].sent[0])
    assert shown.begun


def test_nothing_is_made_for_a_topic_that_nobody_hears(tmp_path) -> None:
    shown, publishers = shows(heard=False)
    for key, payload in shared(tmp_path / "flight.mcap"):
        (shown.receive_head if key == HEAD else shown.receive_chunk)(payload)
    shown.receive_state(encode(state()))
    shown.tick()
    assert not any(publisher.sent for publisher in publishers.values())


def test_alarms_are_diagnostics_until_they_are_over_and_batteries_go_beside_them() -> None:
    shown, publishers = shows()
    alarm = Alarm(1.0, Severity.ERROR, "left", "battery at 12 %", "BATTERY_LOW", "left", goes_on=True)
    for alarms in ((alarm,), (alarm,), (), ()):
        shown.receive_state(encode(state(alarms=alarms)))
        shown.tick()
    shown.tick()  # no new state: the ground is gone, and nothing is said of it
    levels = [[(status[1], status[0]) for status in sent[-1]] for sent in publishers["/diagnostics"].sent]
    name, phase = "formation: left BATTERY_LOW left", ("formation: phase", 0)
    assert levels == [[phase, (name, 2)], [phase, (name, 2)], [phase, (name, 0)], [phase]]
    assert publishers["left/battery_state"].sent[0][3] == pytest.approx(11.4)
    assert len(publishers["/tf_static"].sent) == 5
    assert message_type("diagnostic_msgs/msg/DiagnosticArray").encode(publishers["/diagnostics"].sent[0])


def frame(seq: int) -> LabFrame:
    now_ns = REAL_TIME.monotonic_ns()
    pos, q = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]), np.array([[1.0, 0.0, 0.0, 0.0]] * 2)
    return LabFrame(seq, now_ns - 5_000_000, ("lead", "left"), pos, q, np.array([True, True]), now_ns)


async def between(config: LabConfig, endpoint: str, asked: list[OperatorRequest]) -> tuple[list[Values], list[Values]]:
    """Run `gcs ros2` between a bus with a ground, and a graph: poses heard there, and answers of services."""
    hub = await hub_of(config)
    accepted = iter((True, False))

    def answer(request: OperatorRequest, reply) -> None:
        asked.append(request)
        reply(OperatorReply(request.id, next(accepted), f"{request.verb} heard"))

    hub.serve("main", answer)
    process = asyncio.create_task(
        run(config, "main", Graph(endpoint, DOMAIN), lambda _: None, LOOPBACK_ONLY, REAL_TIME)
    )
    heard: list[Values] = []
    kind = message_type("geometry_msgs/msg/PoseStamped")
    session = opened("client", endpoint)
    session.declare_subscriber(
        f"{DOMAIN}/left/pose/{POSE}", lambda sample: heard.append(kind.decode(sample.payload.to_bytes()))
    )
    poses, seq = MocapBus(hub), 0
    async with asyncio.timeout(60.0):
        while len(heard) < 20:
            seq += 1
            poses.publish_frame(frame(seq))
            await asyncio.sleep(0.01)
    reply = message_type("std_srvs/srv/Trigger_Response")
    replies = [reply.decode((await call(session, f"/{verb}")).ok.payload.to_bytes()) for verb in ("hold", "land")]
    services = await asyncio.to_thread(lambda: list(session.liveliness().get("@ros2_lv/*/*/*/*/SS/**")))
    session.close()
    process.cancel()
    with suppress(asyncio.CancelledError):
        await process
    await hub.close()
    assert {str(service.ok.key_expr).split("/")[9] for service in services} == {"%hold", "%land"}
    return heard, replies


def test_poses_reach_a_ros_graph_and_hold_and_land_alone_are_asked_from_there() -> None:
    config, asked = a_lab(), list[OperatorRequest]()
    with router() as endpoint:
        heard, replies = asyncio.run(between(config, endpoint, asked))
    assert {values[2:] for values in heard} == {("lab", 4.0, 5.0, 6.0, 0.0, 0.0, 0.0, 1.0)}
    assert [(request.verb, request.argument) for request in asked] == [(Verb.HOLD, ""), (Verb.LAND, "")]
    assert all(request.source.startswith("ROS 2 by ") for request in asked)
    assert replies == [(True, "hold heard"), (False, "land heard")]
