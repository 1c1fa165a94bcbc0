from math import pi, sin, sqrt

import numpy as np
import pytest

from formation.config import FlightConfig, FollowerConfig, FormationConfig, LabConfig, LeaderConfig, SlotConfig
from formation.guidance.patterns import PATTERNS, circle, column, grid, line, triangle, vee
from formation.guidance.shape import configured, known, separations, shape_for
from formation.guidance.shape_request import ShapeRequest, parse

ROOT3 = sqrt(3.0)


def lab(n: int = 2, sysid: int | None = 1, **shapes: tuple[SlotConfig, ...]) -> LabConfig:
    return LabConfig(
        leader=LeaderConfig(body="L", sysid=sysid),
        followers=tuple(
            FollowerConfig(body=f"F{k}", sysid=2 + k, offset_m=(-1.0 - k, 0.5, 0.2), yaw_offset_rad=0.1 * k)
            for k in range(n)
        ),
        formation=FormationConfig(spacing_m=0.4, shapes=shapes),
        flight=FlightConfig(observed_leader_altitude_offset_m=0.3),
    )


def test_each_pattern_is_where_its_drawing_says() -> None:
    np.testing.assert_allclose(line(3, 0.5), [[0, 0.5, 0], [0, -0.5, 0], [0, 1.0, 0]], atol=1e-12)
    np.testing.assert_allclose(column(2, 0.5), [[-0.5, 0, 0], [-1.0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(vee(3, sqrt(2.0)), [[-1, 1, 0], [-1, -1, 0], [-2, 2, 0]], atol=1e-12)
    np.testing.assert_allclose(circle(4, 1.0), sqrt(0.5) * 2.0**0.5 * np.array(
        [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]), atol=1e-12)  # fmt: skip
    np.testing.assert_allclose(
        triangle(5, 1.0),
        [[-ROOT3 / 2, 0.5, 0], [-ROOT3 / 2, -0.5, 0], [-ROOT3, 0, 0], [-ROOT3, 1, 0], [-ROOT3, -1, 0]],
        atol=1e-12,
    )
    np.testing.assert_allclose(grid(5, 1.0), [[-1, 0, 0], [-1, 1, 0], [-1, -1, 0], [-2, 0, 0], [-2, 1, 0]], atol=1e-12)


def test_twenty_on_a_circle_are_a_spacing_apart_along_the_chord() -> None:
    ring = circle(20, 0.5)
    np.testing.assert_allclose(np.linalg.norm(ring, axis=1), 0.25 / sin(pi / 20))
    np.testing.assert_allclose(np.linalg.norm(ring - np.roll(ring, 1, axis=0), axis=1), 0.5)


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 7, 12, 20, 33])
def test_every_pattern_gives_n_slots_a_spacing_apart_and_clear_of_the_leader(name: str, n: int) -> None:
    slots = PATTERNS[name](n, 0.4)
    assert slots.shape == (n, 3)
    assert separations(slots).min() >= 0.4 - 1e-12


def test_the_configured_shape_is_the_followers_own_slots() -> None:
    shape = configured(lab())
    assert shape.name == "configured"
    np.testing.assert_allclose(shape.offsets, [[-1.0, 0.5, 0.2], [-2.0, 0.5, 0.2]])
    assert shape.yaw_offset_rad == (0.0, 0.1)


def test_scale_and_heading_act_on_the_whole_shape_and_on_the_headings() -> None:
    shape = shape_for(lab(), ShapeRequest("configured", 2.0, pi / 2))
    np.testing.assert_allclose(shape.offsets, [[-1.0, -2.0, 0.4], [-1.0, -4.0, 0.4]], atol=1e-12)
    assert shape.yaw_offset_rad == pytest.approx((pi / 2, pi / 2 + 0.1))
    assert shape.name == "configured scale=2 heading=90"


def test_a_listed_shape_may_replace_a_pattern_and_an_observed_leader_raises_any() -> None:
    own = (SlotConfig(offset_m=(1.0, 0.0, 0.5), yaw_offset_rad=pi), SlotConfig(offset_m=(2.0, 0.0, 0.0)))
    config = lab(sysid=None, line=own, tail=own)
    for name in ("line", "tail"):
        shape = shape_for(config, ShapeRequest(name))
        np.testing.assert_allclose(shape.offsets, [[1.0, 0.0, 0.8], [2.0, 0.0, 0.3]])
        assert shape.yaw_offset_rad == (pi, 0.0)
    assert known(config) == ("configured", "line", "tail", "triangle", "column", "v", "circle", "grid")
    np.testing.assert_allclose(shape_for(config, ShapeRequest("Column")).offsets[:, 0], [-0.4, -0.8])


def test_a_list_of_the_wrong_length_is_refused() -> None:
    with pytest.raises(ValueError, match="1 slots for 2 followers"):
        lab(tail=(SlotConfig(offset_m=(1.0, 0.0, 0.0)),))


def test_an_unknown_shape_is_answered_with_the_known_ones() -> None:
    with pytest.raises(
        ValueError, match="no shape 'heptagon'; known: configured, triangle, line, column, v, circle, grid"
    ):
        shape_for(lab(), ShapeRequest("heptagon"))


@pytest.mark.parametrize(
    ("text", "request_"),
    [
        ("line", ShapeRequest("line")),
        ("v scale=1.5", ShapeRequest("v", 1.5)),
        ("v scale=100 heading=360", ShapeRequest("v", 100.0, 2.0 * pi)),
        ("v heading=-360", ShapeRequest("v", 1.0, -2.0 * pi)),
        (" circle  heading=-90 scale=2 ", ShapeRequest("circle", 2.0, -pi / 2)),
    ],
)
def test_a_request_is_read_and_written_alike(text: str, request_: ShapeRequest) -> None:
    assert parse(text) == request_
    assert parse(request_.text) == request_


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("line size=2", "'size=2' is not understood"),
        ("line 2", "'2' is not understood"),
        ("line scale=1 scale=2", "'scale=2' is not understood"),
        ("line scale=big", "scale is 'big', not a number"),
        ("line heading=nan", "heading is 'nan', not a finite number"),
        ("line scale=101", "scale is 101; it must be above 0 and at most 100"),
        ("line heading=361", "heading is 361; it is in degrees, at most a whole turn, 360"),
        ("line heading=-361", "heading is -361"),
        ("line scale=0", "scale is 0; it must be above 0"),
        ("line scale=-1", "scale is -1; it must be above 0"),
    ],
)
def test_what_is_wrong_with_a_request_is_said(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        parse(text)
