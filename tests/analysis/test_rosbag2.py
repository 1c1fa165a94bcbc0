"""An exported bag, read by `rosbags` with ROS 2's own types; a leader's poses out of a bag that `rosbags` wrote."""

import json
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner

from analysis.cli import app
from formation import topics
from formation.messages import LabFrame, Phase
from mocap.sources.csv_file import read_recording
from tests.analysis.synthetic_flight import RATE_HZ, START, T0_NS, Recipe, battery, shaken, written
from wire.logs.mcap_read import read_log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("bag") / "flight.mcap"
    recipe = Recipe(error_lead=shaken, leader_yaw_rate_rad_s=0.3)
    return written(file, recipe, more=[battery(T0_NS, 3.5)], start=START)


@pytest.fixture(scope="module")
def bag(log: Path) -> Path:
    result = CliRunner().invoke(app, ["export", str(log), "--rosbag2", "--json"])
    assert result.exit_code == 0, result.output
    folder = Path(json.loads(result.output)["folder"])
    assert folder == log.with_name("flight-rosbag2")
    return folder


def frames_of(log: Path) -> list[LabFrame]:
    return [entry.message for entry in read_log(log).only(topics.MOCAP)]


@pytest.mark.parametrize("distribution", [Stores.ROS2_HUMBLE, Stores.ROS2_KILTED])
def test_poses_are_the_log_s_frames_at_their_exposure(log: Path, bag: Path, distribution: Stores) -> None:
    store = get_typestore(distribution)
    with Reader(bag) as reader:
        poses = [
            store.deserialize_cdr(data, connection.msgtype)
            for connection, _, data in reader.messages([c for c in reader.connections if c.topic == "/left/pose"])
        ]
    seen = [(frame, frame.bodies.index("left")) for frame in frames_of(log)]
    seen = [(frame, row) for frame, row in seen if frame.seen[row]]
    assert len(poses) == len(seen) > 10 * RATE_HZ
    for pose, (frame, row) in zip(poses, seen, strict=True):
        unix_ns = frame.t_capture_ns + START.ahead_ns
        assert pose.header.stamp.sec * 10**9 + pose.header.stamp.nanosec == unix_ns
        position, q = pose.pose.position, pose.pose.orientation
        assert [position.x, position.y, position.z] == frame.pos_lab_m[row].tolist()
        assert [q.w, q.x, q.y, q.z] == frame.q_lab_from_flu[row].tolist()


def test_bag_says_what_is_in_it_as_ros2_bag_info_shows_it(log: Path, bag: Path) -> None:
    with Reader(bag) as reader:
        topics_there = {connection.topic: connection for connection in reader.connections}
        counted = dict.fromkeys(topics_there, 0)
        for connection, unix_ns, _ in reader.messages():
            counted[connection.topic] += 1
            assert reader.start_time <= unix_ns < reader.end_time
        assert {topic: c.msgcount for topic, c in topics_there.items()} == counted
        assert reader.message_count == sum(counted.values())
    latched = topics_there["/tf_static"].ext.offered_qos_profiles[0]
    assert (latched.depth, latched.durability) == (1, QosDurability.TRANSIENT_LOCAL)
    assert counted["/tf_static"] == 1
    assert counted["/left/battery_state"] > 15
    assert {"/lead/odom", "/right/target", "/right/formation_error", "/diagnostics", "/tf"} <= counted.keys()
    with (bag / "flight-rosbag2_0.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}


def test_error_battery_and_phases_are_those_of_the_flight(bag: Path) -> None:
    with AnyReader([bag], default_typestore=get_typestore(Stores.EMPTY)) as reader:  # by the bag's own definitions
        said: dict[str, list] = {}
        for connection, _, data in reader.messages():
            said.setdefault(connection.topic, []).append(reader.deserialize(data, connection.msgtype))
    battery = said["/left/battery_state"][-1]
    assert (battery.voltage, battery.percentage) == (7.5, 0.75)
    assert np.isnan(said["/right/battery_state"][-1].voltage)
    phases = [array.status[0].message.split(":")[0] for array in said["/diagnostics"]]
    assert [p for p in phases if p in Phase.__members__][:3] == ["GROUND", "ARMED", "TAKEOFF"]
    errors = np.array([[m.vector.x, m.vector.y] for m in said["/right/formation_error"]])
    # A millimetre sideways of a leader that turns: in the axes of the lab its length stays.
    flying = np.linalg.norm(errors, axis=1) > 0.0
    assert flying.sum() > 5 * RATE_HZ
    np.testing.assert_allclose(np.linalg.norm(errors[flying], axis=1), 0.001, atol=1e-6)


def test_a_body_s_place_less_its_slot_is_the_error(bag: Path) -> None:
    with AnyReader([bag], default_typestore=get_typestore(Stores.EMPTY)) as reader:
        at: dict[str, dict[int, np.ndarray]] = {"odom": {}, "target": {}, "formation_error": {}}
        for connection, _, data in reader.messages():
            _, body, *topic = connection.topic.split("/")
            if body == "left" and topic and topic[0] in at:
                message = reader.deserialize(data, connection.msgtype)
                place = getattr(message, "vector", None) or getattr(message.pose, "pose", message.pose).position
                stamp = message.header.stamp
                at[topic[0]][stamp.sec * 10**9 + stamp.nanosec] = np.array([place.x, place.y, place.z])
    common = at["odom"].keys() & at["target"].keys() & at["formation_error"].keys()
    flown = [t_ns for t_ns in common if 6e9 <= t_ns - START.unix_ns < 16e9]
    assert len(flown) == 10 * RATE_HZ
    for stamp_ns in flown:
        error = at["odom"][stamp_ns] - at["target"][stamp_ns]
        np.testing.assert_allclose(error, at["formation_error"][stamp_ns], atol=1e-5)


def test_a_folder_that_is_there_is_left_alone(log: Path, bag: Path) -> None:
    before = sorted(path.stat().st_mtime_ns for path in bag.iterdir())
    result = CliRunner().invoke(app, ["export", str(log), "--rosbag2", "--json"])
    assert json.loads(result.stdout)["folder"] == f"{bag}-2"
    assert sorted(path.stat().st_mtime_ns for path in bag.iterdir()) == before


def test_an_exported_bag_is_a_recording_of_a_leader(log: Path, bag: Path) -> None:
    recording = read_recording(bag, "lead")
    frames = [(f, f.bodies.index("lead")) for f in frames_of(log)]
    frames = [(frame, row) for frame, row in frames if frame.seen[row]]
    assert recording.t_ns.tolist() == [f.t_capture_ns - frames[0][0].t_capture_ns for f, _ in frames]
    np.testing.assert_array_equal(recording.pos_mocap_m, [f.pos_lab_m[row] for f, row in frames])
