"""Eq. (2) with the terms of a yawing leader, against matrices and cross products."""

import numpy as np
import pytest

from formation.paper.eq2_relative_frame import copy_motion, lab_from_lead, lead_from_lab
from tests.formation.oracles.frames import to_lab, to_lead

SEEDS = range(8)


@pytest.mark.parametrize("seed", SEEDS)
def test_lead_from_lab_is_eq_2_with_coriolis_euler_and_centripetal_terms(seed: int) -> None:
    motion, frame = np.random.default_rng(seed).normal(size=(2, 3, 4))
    out = np.empty((3, 4))
    lead_from_lab(motion, frame, out)
    np.testing.assert_allclose(out, to_lead(motion, frame), atol=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
def test_lab_from_lead_is_eq_2_turned_round(seed: int) -> None:
    motion, frame = np.random.default_rng(seed).normal(size=(2, 3, 4))
    out = np.empty((3, 4))
    lab_from_lead(motion, frame, out)
    np.testing.assert_allclose(out, to_lab(motion, frame), atol=1e-12)


def test_the_euler_term_carries_a_slot_ahead_to_the_left_as_the_turn_to_the_left_begins() -> None:
    """psi_L'' > 0, at rest: a slot 2 m ahead accelerates by 2 psi_L'' along y."""
    slot, frame, out = np.zeros((3, 4)), np.zeros((3, 4)), np.empty((3, 4))
    slot[0, 0], frame[2, 3] = 2.0, 0.7
    lab_from_lead(slot, frame, out)
    np.testing.assert_allclose(out[2], [0.0, 1.4, 0.0, 0.7], atol=1e-15)


def test_a_copy_is_all_of_a_motion() -> None:
    motion, out = np.random.default_rng(1).normal(size=(3, 4)), np.empty((3, 4))
    copy_motion(motion, out)
    np.testing.assert_array_equal(out, motion)
