"""The figures of the comparison, drawn from flights made by hand."""

from dataclasses import dataclass

import numpy as np
import pytest
from matplotlib.figure import Figure

from analysis.plots import style
from analysis.plots.style import Missing
from formation.maths.arrays import Float
from sim.research import paper_figures as paper


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
