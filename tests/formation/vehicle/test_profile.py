import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.maths import frames
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PROFILES, at_rest, on_ground, profile
from formation.vehicle.rigid_body import ground_effect_gain


def test_paper_profile_as_printed_is_table_1() -> None:
    paper = profile("paper_40g_printed")
    assert paper.mass_kg == 0.04
    assert paper.inertia_kg_m2 == (1.532e-4, 1.532e-4, 3.472e-4)
    assert paper.wheelbase_m == 0.12
    assert GRAVITY_M_S2 == 9.8


def test_the_papers_vehicle_is_the_printed_one_with_an_inertia_that_its_size_can_have() -> None:
    """Of a hand calculation: all mass at the rotors of 60 mm arms at 45 degrees makes 7.2e-5 about x and y."""
    paper, printed = profile("paper_40g"), profile("paper_40g_printed")
    off = {"name", "inertia_kg_m2", "impossible_inertia"}
    assert paper.model_dump(exclude=off) == printed.model_dump(exclude=off)
    at_rotors = 0.04 * (0.06 * np.sin(np.radians(45.0))) ** 2
    assert at_rotors == pytest.approx(7.2e-5)
    assert max(paper.inertia_kg_m2[:2]) < at_rotors < min(printed.inertia_kg_m2[:2])
    assert np.sqrt(paper.inertia_kg_m2[0] / 0.04) < 0.06 < np.sqrt(printed.inertia_kg_m2[0] / 0.04)


@pytest.mark.parametrize("name", PROFILES)
def test_a_vehicle_that_ships_is_a_body_or_says_that_it_is_none(name: str) -> None:
    """Jxx + Jyy - Jzz is twice the sum of m z^2, and so about each axis."""
    jx, jy, jz = profile(name).inertia_kg_m2
    possible = min(jx + jy - jz, jy + jz - jx, jz + jx - jy) >= 0.0
    assert possible is not profile(name).impossible_inertia


@pytest.mark.parametrize("inertia", [(1.532e-4, 1.532e-4, 3.472e-4), (3e-5, 1e-5, 1e-5), (1e-5, 3e-5, 1e-5)])
def test_an_inertia_that_no_body_has_is_refused_unless_it_is_wanted(inertia: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match=r"no body has inertia_kg_m2.*impossible_inertia"):
        profile("paper_40g").model_copy(update={"inertia_kg_m2": inertia})
    wanted = profile("paper_40g").model_copy(update={"inertia_kg_m2": inertia, "impossible_inertia": True})
    assert wanted.inertia_kg_m2 == inertia


def test_a_flat_plate_is_a_body() -> None:
    plate = profile("paper_40g").model_copy(update={"inertia_kg_m2": (1e-5, 2e-5, 3e-5)})
    assert not plate.impossible_inertia


@pytest.mark.parametrize("inertia", [(0.0, 1e-5, 1e-5), (-1e-5, 1e-5, 1e-5)])
def test_an_inertia_is_positive(inertia: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="inertia_kg_m2 must be positive"):
        profile("paper_40g").model_copy(update={"inertia_kg_m2": inertia})


def test_px4_hovers_at_the_measured_thrust() -> None:
    assert profile("px4_quad").hover_thrust_norm == pytest.approx(0.49, abs=1e-9)


def test_arducopter_hovers_at_the_measured_thrust_on_its_simulators_frame() -> None:
    """0.37 was measured; 3 kg and 0.35 m are SIM_Frame's, half of the mass on a ring of that size is its inertia."""
    copter = profile("arducopter_quad")
    assert copter.hover_thrust_norm == pytest.approx(0.37, abs=5e-4)
    radius_m = 0.5 * copter.wheelbase_m
    ring = (0.25 * 3.0 * radius_m**2, 0.25 * 3.0 * radius_m**2, 0.5 * 3.0 * radius_m**2)
    assert copter.inertia_kg_m2 == pytest.approx(ring, rel=0.01)
    assert copter.attitude_p_1_s == pytest.approx(1.0 / 0.15, rel=0.01)


def test_unknown_profile_names_the_known_ones() -> None:
    with pytest.raises(ValueError, match=r"paper_40g.*px4_quad"):
        profile("nonsense")


@given(st.sampled_from(sorted(PROFILES)), st.floats(0.0, 1.0))
def test_thrust_curve_inverts(name: str, norm: float) -> None:
    body = PROFILES[name]
    assert body.thrust_norm_of(body.thrust_n_of(norm)) == pytest.approx(norm, abs=1e-12)


def test_ground_effect_is_cheeseman_bennett_and_fades() -> None:
    # z/R = 1 (feet on the floor): 1 / (1 - 1/16).
    assert ground_effect_gain(0.0, 0.1, 1.0) == pytest.approx(16.0 / 15.0)
    assert ground_effect_gain(1.0, 0.1, 1.0) == pytest.approx(1.0, abs=6e-4)


def test_a_vehicle_at_rest_is_on_the_ground() -> None:
    assert on_ground(at_rest(np.zeros(3), frames.IDENTITY))
    assert not on_ground(at_rest(np.array([0.0, 0.0, 0.1]), frames.IDENTITY))
