"""TOML in and out, and the words of its errors."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from formation.config import FollowerConfig, LabConfig, LeaderConfig, MocapConfig, TrajectoryConfig
from formation.model import Model
from formation.vehicle.profile import PROFILES
from wire.config_file import ConfigError, dump, dump_profile, load, load_profile, parse

LAB = LabConfig(
    mocap=MocapConfig(source="csv", file='f"1"\\ü\t.csv'),
    leader=LeaderConfig(body="lead-er", sysid=1, trajectory=TrajectoryConfig(waypoints_m=((0, 0, 1), (1, 0, 1)))),
    followers=(
        FollowerConfig(body="f1", sysid=2, offset_m=(-0.4, 0.4, 0.0)),
        FollowerConfig(body="f2", sysid=3, offset_m=(-0.4, -0.4, 1e-7), link="udp:127.0.0.1:14540", guard="none"),
    ),
)


def written(tmp_path, text: str):
    path = tmp_path / "lab.toml"
    path.write_text(text, encoding="utf-8")
    return path


def problems(tmp_path, text: str) -> list[str]:
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as caught:
        load(path, LabConfig)
    assert all(line.startswith(f"{path}:") for line in caught.value.problems)
    assert str(caught.value).splitlines() == caught.value.problems
    return [line.removeprefix(f"{path}:").lstrip("0123456789 ") for line in caught.value.problems]


GOOD = """
[leader]
body = "leader"
sysid = 1
[[followers]]
body = "a"
sysid = 2
offset_m = [-0.4, 0.4, 0.0]
"""


class Odd(Model):
    words: str
    number: float
    table: dict[str, dict[str, int]]
    flag: bool
    rows: tuple[tuple[int, ...], ...]


@given(
    st.builds(
        Odd,
        words=st.text(),
        number=st.floats(allow_nan=False, allow_infinity=False),
        table=st.dictionaries(
            st.text(), st.dictionaries(st.text(), st.integers(-(2**63), 2**63 - 1), max_size=3), max_size=3
        ),
        flag=st.booleans(),
        rows=st.lists(st.lists(st.integers(0, 9), max_size=3).map(tuple), max_size=3).map(tuple),
    )
)
def test_any_text_number_and_table_survives_toml(model):
    assert parse(tomllib.loads(dump(model)), Odd, source="x") == model


def test_every_fault_is_one_line_with_file_key_and_reason(tmp_path):
    text = GOOD.replace("sysid = 2", 'sysid = "x"').replace("offset_m", "offset_mm") + "\n[limits]\ntilt_rad = -1\n"
    assert problems(tmp_path, text) == [
        "followers[0].sysid (a): a number is wanted, without quotes (it is 'x')",
        "followers[0].offset_m (a): is missing",
        "followers[0].offset_mm (a): is not a known key: is offset_m meant?",
        "limits.tilt_rad: should be greater than 0 (it is -1)",
    ]


@pytest.mark.parametrize(
    ("right", "wrong", "line", "problem"),
    [
        ("[[followers]]", "[followers]", 5, "followers: is one table: each of a list has double brackets, [[...]]"),
        ("[leader]", "[[leader]]", 2, "leader: is a list of tables: there is one alone, [...] in single brackets"),
        ("sysid = 1", "altitude_m = 1.0", 4, "leader.altitude_m: is not a known key: it belongs in [flight]"),
        ("[-0.4, 0.4, 0.0]", "[ # [\n-0.4,\n0.4,\n0.0]\n'yaw' = 1", 12, "followers[0].yaw (a): is not a known key"),
        ("[[followers]]", 'name = """\n[x]\n"""\n[[followers]]', 5, "leader.name: is not a known key"),
    ],
)
def test_a_fault_has_its_line_and_what_to_do(tmp_path, right: str, wrong: str, line: int, problem: str):
    path = written(tmp_path, GOOD.replace(right, wrong, 1))
    with pytest.raises(ConfigError) as caught:
        load(path, LabConfig)
    assert caught.value.problems == [f"{path}:{line} {problem}"]


def test_a_profile_may_start_from_a_shipped_one(tmp_path):
    own = '[[profiles]]\nname = "ours"\nbase = "px4_quad"\nmass_kg = 1.2\nbattery = { cells = 3 }\n'
    (kind,) = load(written(tmp_path, GOOD + own), LabConfig).profiles
    shipped = PROFILES["px4_quad"]
    battery = shipped.battery.model_copy(update={"cells": 3})
    assert kind == shipped.model_copy(update={"name": "ours", "mass_kg": 1.2, "battery": battery})
    assert load_profile(written(tmp_path, own)) == kind
    with pytest.raises(ConfigError, match="no shipped profile 'x5000': is x500 meant"):
        load_profile(written(tmp_path, own.replace("px4_quad", "x5000")))


def test_a_short_list_is_shown_and_every_fault_has_its_key(tmp_path):
    path = written(tmp_path, GOOD + "\n[mocap]\nq_lab_from_mocap = [1, 1, 0, 0]\n")
    with pytest.raises(ConfigError) as caught:
        load(path, LabConfig)
    (fault,) = caught.value.faults
    assert (fault.key, fault.value) == ("mocap.q_lab_from_mocap", "[1, 1, 0, 0]")
    assert str(caught.value) == f"{path}:11 mocap.q_lab_from_mocap: {fault.reason} (it is [1, 1, 0, 0])"


@pytest.mark.parametrize(
    ("right", "wrong", "line"),
    [
        ('"a"', '"leader"', "followers[0].body (leader): leader has it, too: two vehicles share a body name"),
        ("sysid = 2", "sysid = 1", "followers[0].sysid (a): leader has it, too: two vehicles share a sysid (it is 1)"),
        ("sysid = 2", 'sysid = 2\nprofile = "x5000"', "followers[0].profile (a): unknown vehicle profile 'x5000'"),
        ("[leader]", '[mocap]\nsource = "csv"\n[leader]', "mocap.file: is missing: "),
        ("[leader]", '[mocap]\naxes = ["x up"]\n[leader]', "mocap.axes: three are needed"),
        ("[leader]", "[limits.fence]\nlow_m = [3, 0, 0]\n[leader]", "limits.fence.low_m: low_m is 3 and high_m 2.5"),
        ("[leader]", '[leader]\ntrajectory.kind = "waypoints"', "leader.trajectory.waypoints_m: is missing: "),
        ("[leader]", "[limit]\n[leader]", "limit: is not a known key: is limits meant?"),
        (
            "[leader]",
            "[[formation.shapes.s]]\nofset_m = 1\noffset_m = [1, 0, 0]\n[leader]",
            "formation.shapes.s[0].ofset_m: ",
        ),
    ],
)
def test_a_rule_of_a_table_names_the_key_that_breaks_it_and_the_nearest_of_one_that_is_unknown(
    tmp_path, right, wrong, line
):
    (problem,) = problems(tmp_path, GOOD.replace(right, wrong, 1))
    assert problem.startswith(line)


def test_what_is_dumped_is_loaded_as_the_same_behind_a_byte_order_mark_too(tmp_path):
    path = tmp_path / "marked.toml"
    path.write_text("\ufeff" + dump(LAB), encoding="utf-8")
    assert load(path, LabConfig) == LAB


def test_no_file_no_text_and_no_toml(tmp_path):
    (line,) = problems(tmp_path, "[leader\n")
    assert "line 1" in line
    (tmp_path / "lab.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match="not UTF-8"):
        load(tmp_path / "lab.toml", LabConfig)
    with pytest.raises(ConfigError, match=r"absent\.toml: No such file"):
        load(tmp_path / "absent.toml", LabConfig)
    with pytest.raises(ConfigError, match="Is a directory"):
        load(tmp_path, LabConfig)


@pytest.mark.parametrize("kind", PROFILES.values(), ids=PROFILES)
def test_a_profile_is_written_so_that_a_lab_file_takes_it_and_it_is_read_again(tmp_path, kind):
    path = tmp_path / "vehicle.toml"
    path.write_text(dump_profile(kind))
    assert load_profile(path) == kind
    lab = tmp_path / "lab.toml"
    lab.write_text(
        '[leader]\nbody = "lead"\n[[followers]]\nbody = "left"\nsysid = 2\noffset_m = [0, 1, 0]\n'
        f'profile = "{kind.name}"\n[limits]\nmin_separation_m = 0.3\n\n{dump_profile(kind)}'
    )
    assert load(lab, LabConfig).profiles == (kind,)


def test_a_file_of_two_profiles_is_none(tmp_path):
    path = tmp_path / "vehicles.toml"
    path.write_text(2 * dump_profile(PROFILES["x500"]))
    with pytest.raises(ConfigError, match="one entry"):
        load_profile(path)


def test_a_value_of_few_that_is_misspelt_or_called_otherwise_says_which_is_meant(tmp_path: Path) -> None:
    for written, near in (("optitrack", "natnet"), ("qualysis", "qualisys")):
        (tmp_path / "lab.toml").write_text(f'[mocap]\nsource = "{written}"\n[leader]\nbody = "a"\n')
        with pytest.raises(ConfigError, match=rf"mocap\.source: .*: is {near} meant\? \(it is '{written}'\)"):
            load(tmp_path / "lab.toml", LabConfig)


ROOM = """
[mocap]
source = "vicon"
rate_hz = 200.0
axes = ["x forward", "y left", "z up"]
[mocap.vicon]
host = "10.0.0.1"
[limits]
fence = { low_m = [-1.0, -1.0, -0.1], high_m = [1.0, 1.0, 2.0] }
"""


def in_room(tmp_path, room: str, lab: str = GOOD):
    (tmp_path / "rooms").mkdir()
    (tmp_path / "rooms" / "small.toml").write_text(room, encoding="utf-8")
    return written(tmp_path, f'include = "rooms/small.toml"\n{lab}')


def test_a_lab_flies_in_the_room_that_it_includes_and_what_it_says_itself_wins(tmp_path):
    config = load(in_room(tmp_path, ROOM, f"{GOOD}[mocap]\nrate_hz = 100.0\n[limits]\nspeed_m_s = 1.0\n"), LabConfig)
    assert (config.mocap.source, config.mocap.rate_hz, config.mocap.vicon.host) == ("vicon", 100.0, "10.0.0.1")
    assert (config.limits.fence.high_m, config.limits.speed_m_s) == ((1.0, 1.0, 2.0), 1.0)
    assert config == parse(tomllib.loads(dump(config)), LabConfig, source="x")  # as a log keeps it: whole


@pytest.mark.parametrize(
    ("room", "lab", "problem"),
    [
        (ROOM.replace("200.0", "-1"), GOOD, "{room}:4 mocap.rate_hz: should be greater than 0 (it is -1)"),
        (ROOM.replace("host", "hots"), GOOD, "{room}:7 mocap.vicon.hots: is not a known key: is host meant?"),
        (ROOM, f"{GOOD}[mocap]\nrate_hz = -1\n", "{lab}:11 mocap.rate_hz: should be greater than 0 (it is -1)"),
        (f"include = 'x.toml'\n{ROOM}", GOOD, "{room}: include: {lab} includes this file, which may include none"),
        ("x = ", GOOD, "{lab}: include: {room}: "),
    ],
)
def test_a_fault_is_in_the_file_that_has_the_key(tmp_path, room: str, lab: str, problem: str):
    path = in_room(tmp_path, room, lab)
    with pytest.raises(ConfigError) as caught:
        load(path, LabConfig)
    (said,) = caught.value.problems
    assert said.startswith(problem.format(lab=path, room=tmp_path / "rooms" / "small.toml"))


@pytest.mark.parametrize(
    ("value", "problem"),
    [
        ("'away.toml'", "include: {folder}/away.toml: No such file"),
        ("3", "include: is not the name of a file in quotes"),
    ],
)
def test_an_include_is_a_file_s_name(tmp_path, value: str, problem: str):
    (said,) = problems(tmp_path, f"include = {value}\n{GOOD}")
    assert said.startswith(problem.format(folder=tmp_path))
