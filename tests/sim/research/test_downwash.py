"""A follower that crosses under the other: its jet pushes it down in both hosts, and the ground feeds that forward."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.tracking import track
from formation.control.presets import preset_for
from formation.vehicle.profile import PAPER_40G
from sim.research import host, league
from sim.research.host import Host

SCENE = league.SCENES["crossing"](PAPER_40G)
LOWER = 1


def height_error_m(downwash_share: float, by: Host = Host.STUDY) -> float:
    """The most that the height of the lower one is off while it crosses and after, by its true states."""
    gains = replace(preset_for("default", PAPER_40G, SCENE.lab.mocap), downwash_share=downwash_share)
    outcome, flight = host.fly(SCENE, 1, gains, by)
    assert outcome in ("held", "landed")
    tracking, truth = track(league.true(flight)), flight.truth[SCENE.lab.followers[LOWER].sysid or 0]
    assert truth["dist_lab_m_s2"][:, 2].min() == pytest.approx(-1.97, abs=0.1)
    counted = tracking.formed.all(axis=1) & np.logical_or.accumulate(tracking.scored.all(axis=1))
    return float(np.abs(tracking.error_lead_m[counted, LOWER, 2]).max())


def test_the_feed_forward_halves_the_error_in_lockstep_and_without_it_both_hosts_show_the_same() -> None:
    without_m = height_error_m(0.0, Host.LOCKSTEP)
    assert without_m > 0.02
    assert height_error_m(1.0, Host.LOCKSTEP) < 0.5 * without_m
    assert height_error_m(0.0) == pytest.approx(without_m, rel=0.1)


@pytest.mark.parametrize("believed", [0.65, 1.35])
def test_it_still_does_where_the_force_is_a_third_off(believed: float) -> None:
    assert height_error_m(believed) < 0.5 * height_error_m(0.0)


def test_nothing_is_learned_into_the_thrust_in_a_jet() -> None:
    """Under the other for good: the thrust's scale stays 1, and the disturbance is the downwash."""
    scene = league.SCENES["one under the other"](PAPER_40G)
    _, flight = host.fly(scene, 1)
    dist_m_s2 = flight.state["dist_lab_m_s2"][-100:, 1 + LOWER, 2]
    truth = flight.truth[scene.lab.followers[LOWER].sysid or 0]
    assert np.mean(dist_m_s2) == pytest.approx(truth["dist_lab_m_s2"][-100:, 2].mean(), rel=0.05)
