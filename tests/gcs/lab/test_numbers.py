"""Any number in any key of a lab file: judged, or refused by one line that names the key; never a traceback."""

import copy
import tomllib
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import typer
from hypothesis import given
from hypothesis import strategies as st

from formation.config import LabConfig
from formation.vehicle.profile import PAPER_40G, GainScale
from gcs.lab.cli import judge_lab
from wire.config_file import ConfigError, parse

TRAJECTORIES = [
    '{ kind = "circle", radius_m = 0.3, period_s = 12.0, duration_s = 20.0, laps = 2, yaw_rate_rad_s = 0.1 }',
    '{ kind = "line", length_m = 1.0, duration_s = 8.0, laps = 2 }',
    '{ kind = "hold", duration_s = 8.0 }',
    '{ kind = "figure8", length_m = 1.0, width_m = 0.5, period_s = 12.0, laps = 1 }',
    '{ kind = "lissajous", amplitude_m = [0.5, 0.5, 0.0], cycles = [3, 2, 1], '
    "phase_rad = [0.0, 0.0, 0.0], period_s = 12.0, laps = 1 }",
    '{ kind = "waypoints", waypoints_m = [[0.0,0.0,0.5],[1.0,0.0,0.5]], speed_m_s = 0.5, laps = 1 }',
    '{ kind = "polynomial", waypoints_m = [[0.0,0.0,0.5],[1.0,0.0,0.5],[1.0,1.0,0.5]], speed_m_s = 0.5, laps = 1 }',
    '{ kind = "file", points = [[0.0,0.0,0.0,0.5,0.0],[2.0,1.0,0.0,0.5,0.0]] }',
]
VALUES = [
    float("nan"), float("inf"), float("-inf"), 1e308, -1e308, 5e-324, 1e9, 0, -1, 10**400, True, "1", [], {},
]  # fmt: skip
Place = tuple[str | int, ...]


def lab(trajectory: str) -> dict[str, Any]:
    """Every key of a lab file, its usual value where none is given."""
    values = {
        "origin": (47.0, 8.5, 488.0),
        "mocap": {"source": "natnet", "natnet": {"host": "10.0.0.1"}, "vrpn": {}, "chingmu": {}},
        "leader": {"body": "leader", "sysid": 1, **tomllib.loads(f"trajectory = {trajectory}")},
        "followers": [{"body": "a", "sysid": 2, "profile": "own", "offset_m": (-0.5, 0.5, 0.0)}],
        "formation": {"shapes": {"s": [{"offset_m": (-0.5, 0.0, 0.0), "yaw_offset_rad": 0.1}]}},
        "link": {"kind": "udp"},
        "operator": {"stop_button": {"device": "/dev/x", "button": 57}},
        "profiles": [PAPER_40G.model_copy(update={"name": "own", "gain_scale": GainScale()})],
    }
    return LabConfig.model_validate(values).model_dump(mode="json", exclude_none=True)


def numbers(values: Any, place: Place = ()) -> Iterator[Place]:
    """Where in a file there is a number."""
    if isinstance(values, dict | list):
        for key, inner in values.items() if isinstance(values, dict) else enumerate(values):
            yield from numbers(inner, (*place, key))
    elif isinstance(values, int | float) and not isinstance(values, bool):
        yield place


def changed(values: dict[str, Any], place: Place, value: object) -> dict[str, Any]:
    new: Any = copy.deepcopy(values)
    table = new
    for key in place[:-1]:
        table = table[key]
    table[place[-1]] = value
    return dict(new)


@pytest.mark.parametrize("trajectory", TRAJECTORIES)
@given(drawn=st.data())
def test_any_number_is_judged_or_rejected_in_one_line_that_names_its_key(trajectory: str, drawn: st.DataObject) -> None:
    values = lab(trajectory)
    place = drawn.draw(st.sampled_from(list(numbers(values))))
    key = next(part for part in reversed(place) if isinstance(part, str))
    said = problems(changed(values, place, drawn.draw(st.sampled_from(VALUES))))
    assert all("\n" not in problem and len(problem) < 400 for problem in said), said
    assert not said or key in "".join(said), said


def problems(values: dict[str, Any]) -> list[str]:
    """What keeps the lab from being read; nothing where it is judged and drawn."""
    try:
        config = parse(values, LabConfig, source="lab.toml", folder=Path())
    except ConfigError as error:
        return error.problems
    with suppress(typer.Exit):
        judge_lab(Path("lab.toml"), config, as_json=False)
    return []


@pytest.mark.parametrize(("place", "value"), [(("limits", "speed_m_s"), True), (("leader", "sysid"), True)])
def test_true_is_no_number(place: Place, value: object) -> None:
    with pytest.raises(ConfigError, match="a number is wanted"):
        parse(changed(lab(TRAJECTORIES[0]), place, value), LabConfig, source="lab.toml")
