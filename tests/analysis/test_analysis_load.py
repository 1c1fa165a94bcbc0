"""The log as columns: order, axes, phases."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from synthetic_flight import LAB, METADATA, PHASES, T0_NS, Recipe, Record, records

from analysis.load import from_records
from analysis.metrics import summarise
from formation import frames, topics
from formation.config import MocapConfig
from formation.messages import MocapFrame, Phase


def short(recipe: Recipe) -> list[Record]:
    return [r for r in records(recipe) if r.t_ns < T0_NS + 10_000_000_000]


def test_bodies_come_in_the_configurations_order_whatever_the_mocaps():
    flights = [from_records(METADATA, short(Recipe(bodies=order))) for order in ((0, 1, 2), (2, 0, 1))]
    np.testing.assert_array_equal(flights[0].poses.pos_lab_m, flights[1].poses.pos_lab_m)
    assert [v.body for v in flights[0].vehicles] == ["lead", "left", "right"]
    assert [v.column for v in flights[0].vehicles] == [0, 1, 2]


def test_poses_are_turned_from_the_mocaps_axes_and_the_markers_frame():
    """A y-up mocap with a shifted origin and a leader whose markers are a quarter turn off: the same lab poses."""
    plain = short(Recipe())
    q_lab_from_mocap = frames.from_rotation_vector(np.array([np.pi / 2.0, 0.0, 0.0]))
    origin = np.array([0.5, -0.2, 0.1])
    q_marker_from_flu = frames.from_yaw(np.array(np.pi / 2.0))

    def seen_by_mocap(frame: MocapFrame) -> MocapFrame:
        back = frames.inverse(q_lab_from_mocap)
        leader = np.array([body == "lead" for body in frame.bodies])[:, None]
        q_marker = frames.multiply(frame.q_lab_from_flu, frames.inverse(q_marker_from_flu))
        q = frames.multiply(back, np.where(leader, q_marker, frame.q_lab_from_flu))
        return replace(frame, pos_lab_m=frames.rotate(back, frame.pos_lab_m - origin), q_lab_from_flu=q)

    turned = [replace(r, message=seen_by_mocap(r.message)) if r.topic is topics.MOCAP else r for r in plain]
    mocap = MocapConfig(q_lab_from_mocap=tuple(q_lab_from_mocap), origin_lab_m=tuple(origin))
    leader = LAB.leader.model_copy(update={"q_marker_from_flu": tuple(q_marker_from_flu)})
    lab = LAB.model_copy(update={"mocap": mocap, "leader": leader})
    one = from_records(METADATA, plain).poses
    two = from_records(METADATA | {"lab": lab.model_dump_json()}, turned).poses
    np.testing.assert_allclose(two.pos_lab_m, one.pos_lab_m, atol=1e-12)
    np.testing.assert_allclose(two.q_lab_from_flu, one.q_lab_from_flu, atol=1e-12)


def test_what_is_no_pose_is_unseen():
    kept = [r for r in short(Recipe()) if r.topic is topics.MOCAP][:3]
    broken = kept[1].message
    broken.pos_lab_m[0] = np.nan
    broken.q_lab_from_flu[1] = 0.0
    poses = from_records(METADATA, kept).poses
    assert poses.seen.sum(axis=1).tolist() == [3, 1, 3]
    assert np.isfinite(poses.pos_lab_m).all()


def test_phases_are_stretches_that_end_where_the_next_begins():
    flight = from_records(METADATA, records(Recipe()))
    assert [span.phase for span in flight.phases] == [phase for _, phase, _ in PHASES]
    assert [span.start_s for span in flight.phases] == pytest.approx([start for start, _, _ in PHASES])
    assert [a.end_s for a in flight.phases[:-1]] == [b.start_s for b in flight.phases[1:]]
    assert flight.spans(Phase.LAND)[0].cause == "operator"


def test_receipt_and_capture_are_told_apart():
    poses = from_records(METADATA, short(Recipe())).poses
    np.testing.assert_allclose(poses.received_s - poses.t_s, 0.004, atol=1e-9)


def test_without_a_configuration_the_bodies_name_the_vehicles():
    flight = from_records({}, short(Recipe(bodies=(0, 1, 2))))
    assert flight.run.lab is None
    assert [(v.body, v.column) for v in flight.vehicles] == [("lead", 0), ("left", 1), ("right", 2)]
    assert summarise(flight).formation_rms_m is not None


@dataclass(frozen=True)
class Odd:
    """A record whose message is not of its topic's type."""

    topic = topics.MOCAP
    t_ns = T0_NS
    message = "not a frame"


def test_a_message_of_the_wrong_type_is_left_out():
    assert len(from_records(METADATA, [Odd()]).poses) == 0
