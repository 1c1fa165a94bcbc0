"""The figures of the comparison, drawn from flights made by hand."""

from dataclasses import dataclass

import numpy as np
import pytest
from matplotlib.figure import Figure

from analysis.plots import paper, style
from analysis.plots.style import Missing
from formation.maths.arrays import Float


@dataclass(frozen=True)
class Flown:
    """A leader on the x axis, two followers that swing about their slots, and a gust at 3 s."""

    t_s: Float
    path_m: Float
    error_m: Float
    gust_m_s2: Float
    z3_m_s2: Float


def flown(swing_m: float) -> Flown:
    t_s = np.linspace(0.0, 14.0, 1401)
    error = swing_m * np.stack([np.sin(9.0 * t_s + phase) for phase in (0.0, 1.0, 2.0, 3.0)], axis=-1).reshape(-1, 2, 2)
    leader = np.stack([0.1 * t_s, 0.0 * t_s], axis=-1)
    slots = np.array([[-0.4, -0.4], [-0.4, 0.4]])
    gust = -3.0 * np.exp(-(((t_s - 3.0) / 0.2) ** 2))
    path = np.concatenate([leader[:, None], leader[:, None] + slots + error], axis=1)
    return Flown(t_s, path, error, gust, gust + 0.1)


TRACES = {name: flown(0.001 * (k + 1)) for k, name in enumerate(paper.NAMES)}


@pytest.mark.parametrize("draw", [paper.gust, paper.formation, paper.deviations])
def test_each_figure_names_every_controller(draw):
    with style.styled():
        drawn = draw(TRACES)
    assert isinstance(drawn, Figure)
    text = style.svg(drawn)
    assert all(name in text for name in paper.NAMES.values())


@pytest.mark.parametrize("draw", [paper.gust, paper.formation, paper.deviations])
def test_a_comparison_without_flights_says_so(draw):
    assert isinstance(draw({}), Missing)


def test_the_gust_is_at_time_zero():
    with style.styled():
        drawn = paper.gust(TRACES)
    assert isinstance(drawn, Figure)
    true = drawn.axes[-1].lines[2]
    t_s, push = np.asarray(true.get_xdata()), np.asarray(true.get_ydata())
    assert abs(t_s[np.argmin(push)]) < 0.25


def test_the_grey_line_is_where_the_follower_should_be():
    with style.styled():
        drawn = paper.formation({"cfc": TRACES["smc"]})
    assert isinstance(drawn, Figure)
    np.testing.assert_allclose(np.asarray(drawn.axes[0].lines[0].get_ydata()), -0.4, atol=1e-12)
