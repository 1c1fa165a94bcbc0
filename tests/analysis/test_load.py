"""The log as columns: order, axes, phases."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.load import from_records, load_checked
from analysis.metrics import summarise
from formation import topics
from formation.messages import AttitudeTarget, Phase
from tests.analysis.synthetic_flight import METADATA, PHASES, T0_NS, Recipe, Record, records, written


def short(recipe: Recipe) -> list[Record]:
    return [r for r in records(recipe) if r.t_ns < T0_NS + 10_000_000_000]


def test_frames_that_no_mocap_process_of_ours_sends_are_left_out():
    kept = [r for r in short(Recipe()) if r.topic is topics.MOCAP][:5]
    kept[1].message.pos_lab_m[0] = np.nan
    kept[2].message.q_lab_from_flu[1] = 0.0
    kept[3] = replace(kept[3], message=replace(kept[3].message, seen=np.ones(2, dtype=np.bool_)))
    poses = from_records(METADATA, kept).poses
    assert len(poses) == 2
    assert np.isfinite(poses.pos_lab_m).all()


def test_phases_are_stretches_that_end_where_the_next_begins():
    flight = from_records(METADATA, records(Recipe()))
    assert [span.phase for span in flight.phases] == [phase for _, phase, _ in PHASES]
    assert [span.start_s for span in flight.phases] == pytest.approx([start for start, _, _ in PHASES])
    assert [a.end_s for a in flight.phases[:-1]] == [b.start_s for b in flight.phases[1:]]
    assert flight.spans(Phase.LAND)[0].cause == "operator"


def test_the_vehicles_are_the_configurations_and_receipt_is_told_from_capture():
    flight = from_records(METADATA, short(Recipe()))
    assert [(v.body, v.column) for v in flight.vehicles] == [("lead", 0), ("left", 1), ("right", 2)]
    poses = flight.poses
    np.testing.assert_allclose(poses.received_s - poses.t_s, 0.004, atol=1e-9)


def test_without_a_configuration_the_bodies_name_the_vehicles():
    flight = from_records({}, short(Recipe(bodies=(0, 1, 2))))
    assert flight.run.lab is None
    assert [(v.body, v.column) for v in flight.vehicles] == [("lead", 0), ("left", 1), ("right", 2)]
    assert summarise(flight).formation_rms_m is not None


def test_a_message_of_the_wrong_type_is_left_out():
    assert len(from_records(METADATA, [Record(topics.MOCAP, T0_NS, "not a frame")]).poses) == 0


def test_one_stamp_of_another_year_is_left_out_and_counted(tmp_path):
    """The report made a list of windows to the last target's stamp: 15 GiB."""
    last = [record for record in records(Recipe()) if isinstance(record.message, AttitudeTarget)][-1]
    odd = replace(last, message=replace(last.message, t_ns=T0_NS + 3 * 10**18))
    path = written(tmp_path / "flight.mcap", Recipe(), more=[odd])
    flight, found = load_checked(path)
    assert flight.target.t_s[-1] < 60.0
    assert "outside the log's own time, left out: 1" in found.damage
