"""Ways that other systems fly: Crazyswarm's polynomials, a Skybrush show."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from formation.guidance.trajectory import anchored, sample
from formation.trajectory_config import TrajectoryConfig
from wire.path_files import POLYNOMIAL, read_points

T_S = 2.0


def step(scale: float) -> list[float]:
    """The coefficients of a step of the seventh order from rest to rest over T_S: 35 u^4 - 84 u^5 + 70 u^6 - 20 u^7."""
    return [0.0] * 4 + [scale * c / T_S**k for k, c in ((4, 35.0), (5, -84.0), (6, 70.0), (7, -20.0))]


def polynomials(path: Path, pieces: list[list[float]]) -> Path:
    lines = [",".join(f"{number:.6f}" for number in piece) + "," for piece in pieces]
    path.write_text("\n".join([",".join(POLYNOMIAL) + ",", *lines]))
    return path


def show(path: Path, points: list[object], inline: bool = False) -> Path:
    trajectory = {"version": 1, "takeoffTime": 0.0, "points": points}
    settings = {"trajectory": trajectory if inline else {"$ref": "./drones/drone_1/trajectory.json#"}}
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("show.json", json.dumps({"version": 1, "swarm": {"drones": [{"settings": settings}]}}))
        file.writestr("drones/drone_1/trajectory.json", json.dumps(trajectory))
    return path


def flown(points: list[list[float]], t_s: float, *, relative: bool = False) -> np.ndarray:
    config = TrajectoryConfig(kind="file", points=tuple(map(tuple, points)), relative=relative)
    path = anchored(config, np.array([1.0, 2.0, 0.8]), 0.0)
    motion = np.empty((3, 4))
    sample(path.kind, path.numbers, path.knots, t_s, motion)
    return motion


def test_crazyswarm_s_polynomials_are_flown_one_after_the_other(tmp_path: Path) -> None:
    there = [T_S, *step(1.0), *step(-0.5), *step(0.0), *step(0.6)]
    back = [T_S, 1.0, *step(-1.0)[1:], -0.5, *step(0.5)[1:], *step(0.0), 0.6, *step(-0.6)[1:]]
    points = read_points(polynomials(tmp_path / "figure.csv", [there, back]))
    u = 0.3
    way = 35 * u**4 - 84 * u**5 + 70 * u**6 - 20 * u**7
    speed = 140 * u**3 * (1 - u) ** 3 / T_S
    motion = flown(points, u * T_S)
    np.testing.assert_allclose(motion[0], [way, -0.5 * way, 0.0, 0.6 * way], atol=2e-5)
    np.testing.assert_allclose(motion[1, :2], [speed, -0.5 * speed], atol=2e-3)
    np.testing.assert_allclose(flown(points, 2.0 * T_S)[0], 0.0, atol=1e-5)
    np.testing.assert_allclose(flown(points, T_S, relative=True)[0, :3], [2.0, 1.5, 0.8], atol=1e-5)


@pytest.mark.parametrize("inline", [False, True])
def test_a_show_of_skybrush_is_flown_between_take_off_and_landing(tmp_path: Path, inline: bool) -> None:
    """A quarter of a circle as the usual cubic, which misses it by 0.03 %."""
    k = 0.5522847498
    points = [
        [0.0, [1.0, 0.0, 0.0], []],
        [2.0, [1.0, 0.0, 1.0], []],
        [5.0, [0.0, 1.0, 1.0], [[1.0, k, 1.0], [k, 1.0, 1.0]]],
        [7.0, [0.0, 1.0, 0.0], []],
    ]
    read = np.array(read_points(show(tmp_path / "show.skyc", points, inline)))
    assert read[0] == pytest.approx([0.0, 1.0, 0.0, 1.0, 0.0])
    assert read[-1] == pytest.approx([3.0, 0.0, 1.0, 1.0, 0.0])
    np.testing.assert_allclose(np.hypot(read[:, 1], read[:, 2]), 1.0, atol=3e-4)


@pytest.mark.parametrize("aside_m", [0.0, 0.002, 0.05])
def test_a_show_begins_where_its_climb_ends_though_that_wanders(tmp_path: Path, aside_m: float) -> None:
    """Points are rounded to millimetres; neither climb nor descent goes straight up."""
    rng = np.random.default_rng(1)
    u = np.linspace(0.0, 1.0, 21)
    eased = u**3 * (10 - 15 * u + 6 * u**2)
    lean = aside_m * eased + (0.002 * rng.uniform(-1, 1, 21) if aside_m else 0.0)
    legs = [
        (5 * u, lean, eased),
        (5 + 7 * u, aside_m + 0.6 * eased, 1 + 0 * u),
        (12 + 5 * u, aside_m + 0.6 + lean, 1 - eased),
    ]
    points = [[round(t, 3), [round(x, 3), 0.0, round(z, 3)], []] for leg in legs for t, x, z in zip(*leg, strict=True)]
    points = [a for a, b in zip(points, [*points[1:], [99.0]], strict=True) if a[0] < b[0]]
    read = np.array(read_points(show(tmp_path / "show.skyc", points)))
    assert read[:, 3].min() > 0.95
    assert 6.5 < read[-1, 0] < 8.5


@pytest.mark.parametrize(
    ("points", "told"),
    [
        ([], "no show of Skybrush"),
        ([[0.0, [0.0, 0.0, 0.0], []], [2.0, [0.0, 0.0, 1.0], []]], "only goes up and down"),
        ([[0.0, [0.0, 0.0, 1.0], []], [0.0, [1.0, 0.0, 1.0], []]], "times must rise"),
        ([[0.0, [0.0, 0.0, 1.0], []], [9e9, [1.0, 0.0, 1.0], []]], "at most"),
        ([["a", [0.0, 0.0, 1.0], []]], "show.skyc: "),
        ([[0.0, [0.0, 0.0, 10**400], []], [1.0, [1.0, 0.0, 1.0], []]], "show.skyc: "),
        ([[10**400, [0.0, 0.0, 1.0], []], [1.0, [1.0, 0.0, 1.0], []]], "show.skyc: "),
        ([[0.0, [0.0, 0.0, 1e300], []], [1.0, [1.0, 0.0, 1.0], []]], "a point is not finite"),
        ([[0.0, [0.0], []], [1.0, [1.0, 0.0, 1.0], []]], "show.skyc: "),
    ],
)
def test_a_show_that_is_none_is_named(tmp_path: Path, points: list[object], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        read_points(show(tmp_path / "show.skyc", points))


WAY = [(0.0, 0.0, 0.1, 1.0, 0.5), (2.0, 0.4, 0.2, 1.5, -0.5)]
EQUALS = {
    "bare": ("", ",", (1, 1, 1, 1, 1)),
    "spreadsheet": ("time,x,y,z,yaw", ",", (1, 1, 1, 1, 1)),
    "units": ("t [s],x [m],y [m],z [m],yaw [rad]", ",", (1, 1, 1, 1, 1)),
    "a comment": ("# t,x,y,z,yaw", ",", (1, 1, 1, 1, 1)),
    "milliseconds, millimetres, degrees": ("Time [msec],x [mm],y,z,Yaw (°)", ",", (1e3, 1e3, 1e3, 1e3, np.degrees(1))),
    "names with units": ("time_ms,x_cm,y_cm,z_cm,yaw_deg", "\t", (1e3, 1e2, 1e2, 1e2, np.degrees(1))),
    "blanks": ("t x y z yaw", " ", (1, 1, 1, 1, 1)),
    "decimal commas": ("t;x;y;z;heading", ";", (1, 1, 1, 1, 1)),
}


@pytest.mark.parametrize("name", EQUALS)
def test_a_way_reads_the_same_from_every_program(tmp_path: Path, name: str) -> None:
    head, mark, scales = EQUALS[name]
    lines = [mark.join(f"{s * v:.6f}" for s, v in zip(scales, row, strict=True)) for row in WAY]
    text = "\n".join([head.replace(",", mark), *lines] if head else lines)
    (tmp_path / "way.csv").write_text(text.replace(".", ",") if mark == ";" else text)
    np.testing.assert_allclose(read_points(tmp_path / "way.csv"), WAY, atol=1e-6)


def test_a_way_may_have_another_order_further_columns_and_no_heading(tmp_path: Path) -> None:
    (tmp_path / "way.csv").write_text("Red,z [m],Time [msec],x [m],y [m]\n255,1,0,0.1,0.2\n0,1.5,2000,0.3,0.2\n")
    np.testing.assert_allclose(read_points(tmp_path / "way.csv"), [[0, 0.1, 0.2, 1, 0], [2, 0.3, 0.2, 1.5, 0]])


def test_a_line_of_polynomials_that_is_cut_off_is_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"figure.csv:2: 9 columns, duration, x\^0"):
        read_points(polynomials(tmp_path / "figure.csv", [[T_S, *step(1.0)[:7]]]))
