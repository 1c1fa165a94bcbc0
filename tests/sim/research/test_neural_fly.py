"""Neural-Fly's recordings: read by the line, replayed as a push, and, where they have been fetched, flown against."""

from pathlib import Path

import numpy as np
import pytest

from sim.research import league
from sim.research.laws import chosen
from sim.research.neural_fly import VEHICLE, Recording, flown_rms_m, read, wind

HEADER = ",t,p,p_d,fa,pwm"
LINE = '{k},{t},"[1.0, 2.0, {z}]","[1.0, 2.0, 3.0]","[5.288, 0.0, -2.644]","[1200.0]"'
FETCHED = Path(__file__).parents[3].parent / "neural-fly" / "data" / "experiment"
"""Beside the project."""


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join((HEADER, *lines)), encoding="utf-8")
    return path


def test_a_recording_is_read_and_judged_once_it_has_settled(tmp_path: Path) -> None:
    """1 cm off until 5 s, then 3 and 4 cm off: the RMS is sqrt((9 + 16) / 2) cm."""
    z_of = {0.0: 3.01, 5.0: 3.01, 5.5: 3.03, 6.0: 2.96}
    lines = [LINE.format(k=k, t=7.0 + t, z=z) for k, (t, z) in enumerate(z_of.items())]
    found = read(write(tmp_path / "a.csv", *lines))
    assert found.t_s.tolist() == [0.0, 5.0, 5.5, 6.0]
    assert found.residual_n[0].tolist() == [5.288, 0.0, -2.644]
    assert found.rms_m == pytest.approx(0.01 * np.sqrt(12.5))


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ('1,1.0,"[1.0, 2.0]","[1.0, 2.0, 3.0]","[0.0, 0.0, 0.0]",""', r"a.csv:3 p: 2 numbers in a list of 3"),
        ('1,1.0,"[1.0, 2.0, x]","[1.0, 2.0, 3.0]","[0.0, 0.0, 0.0]",""', "a.csv:3 p: not a list of numbers"),
        (
            '1,1.0,"[1.0, 2.0, 3.0]","[1.0, 2.0, 3.0]","[0.0, 0.0, NaN]","[1.0]"',
            r"a.csv: fa\[2\] has values that are no finite number",
        ),
        (LINE.format(k=1, t=-1.5, z=3.0), "time goes back"),
    ],
)
def test_what_is_no_recording_is_named_by_line_and_column(tmp_path: Path, line: str, text: str) -> None:
    path = write(tmp_path / "a.csv", LINE.format(k=0, t=0.0, z=3.0), line)
    with pytest.raises(match=text):
        read(path)


def test_the_wind_rises_with_the_recording_and_ends_with_it() -> None:
    """4 s at a point, pushed by 2 m/s^2 along x; the leader is not."""
    t_s, still = np.array([0.0, 2.0, 4.0]), np.tile([0.25, 0.0, 2.0], (3, 1))
    recording = Recording(t_s, still, still, np.tile([2.0 * VEHICLE.mass_kg, 0.0, 0.0], (3, 1)))
    blown = wind(recording, 0.25)
    assert blown.shape == (16, 2, 3)
    assert not blown[:, 0].any()
    assert blown[[0, 1, 4, 15], 1] == pytest.approx(np.outer([0.0, 1.0, 2.0, 2.0], [1.0, 0.0, 0.0]))


@pytest.mark.skipif(not FETCHED.is_dir(), reason=f"no recordings in {FETCHED}: fetch aerorobotics/neural-fly")
def test_the_recorded_flights_are_those_of_the_article_and_ours_are_closer() -> None:
    """The article's table: 11.4 cm of its baseline and 3.1 of Neural-Fly without wind, 23.5 and 9.4 at 12.1 m/s."""
    told = flown_rms_m(FETCHED)
    for scene, baseline_cm, best_cm in (("Neural-Fly, 0 m/s", 11.4, 3.1), ("Neural-Fly, 12.1 m/s", 23.5, 9.4)):
        assert 100.0 * told["baseline"][scene] == pytest.approx(baseline_cm, abs=0.05)
        assert 100.0 * told["NF"][scene] == pytest.approx(best_cm, abs=0.05)
        (row,) = league.rows([chosen("default")], [scene], [], recordings=FETCHED)
        ours = league.fly(row)
        assert ours.outcome == "held"
        assert ours.rms_m is not None
        assert 100.0 * ours.rms_m < best_cm
