"""Pushes found live, of frames and errors as they come, against the report of the same flight's log."""

import re

import numpy as np
import pytest

from analysis import pushes
from analysis.load import Flight
from formation.messages import LabFrame
from gcs.page.pushes import PushFinder
from sim.studies import host
from sim.studies.experiments import Experiment, Job, scenario_of


def live(flight: Flight) -> list[tuple[float, str]]:
    """What the page shows while the flight is flown, and from when on: frames as they come, ten errors a second."""
    assert flight.run.lab is not None
    finder, shown, bodies = PushFinder(flight.run.lab), [(0.0, "")], tuple(v.body for v in flight.vehicles)
    poses = flight.poses
    slot_lab_m = np.median(poses.pos_lab_m[:, 1], axis=0)
    for k, t_s in enumerate(poses.t_s.tolist()):
        capture_ns, receive_ns = round(1e9 * t_s), round(1e9 * poses.received_s[k])
        finder.receive_frame(
            LabFrame(k, capture_ns, bodies, poses.pos_lab_m[k], poses.q_lab_from_flu[k], poses.seen[k], receive_ns)
        )
        if k % 10 == 0:
            finder.receive_errors({bodies[1]: poses.pos_lab_m[k, 1] - slot_lab_m}, capture_ns)
            if finder.text != shown[-1][1]:
                shown.append((t_s, finder.text))
    return shown[1:]


def test_each_push_is_shown_within_three_seconds_as_in_the_report() -> None:
    _, flight = host.fly(scenario_of(Job("cfc", Experiment.GUST, 1)), 1)
    shown, reported = live(flight), [push for _, push in pushes.found(flight)]
    assert len(shown) >= len(reported) - 1  # the last may be over when the flight is
    assert re.search(r"; mean of \d: \d\d and \d\d mm$", shown[-1][1])
    for (t_s, text), push in zip(shown, reported, strict=False):
        assert push.begin_s + 1.0 < t_s < push.begin_s + 3.0
        possible_mm, flown_mm = (float(part.split(" mm ")[0].split()[-1]) for part in text.split(", ")[:2])
        assert flown_mm == pytest.approx(1e3 * push.flown_m, rel=0.1)
        assert possible_mm == pytest.approx(1e3 * push.by_attitude_m, abs=30.0)  # another window, another noise


def test_nothing_is_shown_of_drones_at_their_places_nor_of_frames_of_others() -> None:
    lab = scenario_of(Job("cfc", Experiment.GUST, 1)).lab
    bodies = tuple(vehicle.body for vehicle in lab.vehicles)
    for off_m, named in ((0.002, bodies), (0.2, bodies[:1])):
        finder = PushFinder(lab)
        for k in range(1000):
            pos, q = np.zeros((len(named), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(named), 1))
            finder.receive_frame(LabFrame(k, k * 10_000_000, named, pos, q, np.ones(len(named), np.bool_)))
            if k % 10 == 0:
                finder.receive_errors({bodies[1]: np.array([off_m, 0.0, 0.0])}, k * 10_000_000)
        assert finder.text == ""
