import re

import pytest
from pydantic import ValidationError

from formation.config import PRESET_NAMES, LabConfig
from formation.control.presets import PRESETS
from formation.vehicle.profile import PAPER_40G, BatteryProfile


def lab(**changes: object) -> LabConfig:
    followers = [{"body": "b", "sysid": 2, "offset_m": (-0.4, 0.0, 0.0)}]
    return LabConfig.model_validate({"leader": {"body": "a", "sysid": 1}, "followers": followers, **changes})


def test_a_lab_may_name_a_vehicle_of_its_own():
    own = PAPER_40G.model_copy(update={"name": "ours", "mass_kg": 0.05})
    config = lab(profiles=[own.model_dump()], leader={"body": "a", "sysid": 1, "profile": "ours"})
    assert [config.profile_of(v).mass_kg for v in config.vehicles] == [0.05, 0.04]


@pytest.mark.parametrize(
    ("leader", "links"),
    [
        ({"body": "a", "sysid": 1}, "zenoh"),
        ({"body": "a"}, "zenoh"),
        ({"body": "a", "sysid": 1, "link": "udp:127.0.0.1:14540", "guard": "none"}, "udp and zenoh"),
    ],
)
def test_the_links_told_are_those_that_drones_are_on(leader, links):
    assert lab(leader=leader).link_kinds == links


def test_the_presets_that_a_lab_may_name_are_those_there_are():
    assert tuple(PRESETS) == PRESET_NAMES


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"leader": {"body": "b"}}, "share a body name"),
        ({"leader": {"body": "a", "sysid": 2}}, "share a sysid"),
        ({"leader": {"body": "a", "profile": "nope"}}, "unknown vehicle profile 'nope'; known: paper_40g, paper_40g_"),
        ({"mocap": {"q_lab_from_mocap": (1, 1, 0, 0)}}, "its length is 1.414, not 1"),
        ({"mocap": {"q_lab_from_mocap": (0, 0, 0, 0)}}, "its length is 0.000, not 1"),
        ({"leader": {"body": "a", "q_marker_from_flu": (0.72, 0.72, 0, 0)}}, "its length is 1.018, not 1"),
        ({"limits": {"fence": {"low_m": (1, -1, 0), "high_m": (-1, 1, 2)}}}, "low_m is 1 and high_m -1 along x"),
        ({"limits": {"fence": {"low_m": (-1, -1, 2), "high_m": (1, 1, 2)}}}, "low_m is 2 and high_m 2 along z"),
        ({"limits": {"tilt_rad": 30}}, "radians are meant"),
        ({"limits": {"battery_low_share": 20}}, "limits.battery_low_share"),
        ({"limits": {"battery_empty_share": 0.3}}, "battery_low_share is 0.2: empty is not more than low"),
        ({"control_preset": "heroic"}, "unknown control preset 'heroic'; known: default, pid_leader, paper"),
        ({"leader": {"body": "a", "link": "tcp:1"}}, "not udp:HOST:PORT"),
        ({"leader": {"body": "a", "link": "udp:127.0.0.1:14540"}}, 'write guard = "none" to fly so'),
        ({"leader": {"body": "a", "link": "udp:127.0.0.1:0", "guard": "none"}}, "port 0 is not within 1 to 65535"),
        (
            {"leader": {"body": "a", "link": "udp:127.0.0.1:70000", "guard": "none"}},
            "port 70000 is not within 1 to 65535",
        ),
        ({"link": {"zenoh_listen": ["tcp/0.0.0.0:99999"]}}, "port 99999 is not within 0 to 65535"),
        ({"link": {"zenoh_connect": ["tcp/127.0.0.1"]}}, "not an endpoint such as tcp/127.0.0.1:7447"),
        ({"link": {"host": "127.0.0.256"}}, "not an IPv4 address"),
        ({"link": {"host": "my host"}}, "not the name or the IPv4 address of a host"),
        ({"link": {"ground_port_base": 70000}}, "less than or equal to 65285"),
        ({"link": {"drone_port_base": 80}}, "greater than or equal to 1024"),
        ({"origin": (147.0, 8.0, 400.0)}, "not a place on the globe"),
        ({"leader": {"body": "a", "sysid": 1, "trajectory": {"kind": "waypoints"}}}, "needs `waypoints_m`"),
        ({"leader": {"body": "a", "sysid": 1, "trajectory": {"kind": "csv", "file": "x"}}}, 'write "file"'),
        (
            {"leader": {"body": "a", "sysid": 1, "trajectory": {"kind": "circle", "laps": 0}}},
            "greater than or equal to 1",
        ),
        ({"formation": {"shapes": {"configured": [{"offset_m": (0, 1, 0)}]}}}, "the followers' own slots"),
    ],
)
def test_what_one_field_has_wrong_is_refused_by_every_program_that_reads_it(changes, words):
    with pytest.raises(ValidationError, match=re.escape(words)):
        lab(**changes)


@pytest.mark.parametrize("q", [(0.707, 0.707, 0, 0), (0.7071, 0, 0, -0.7071), (-1, 0, 0, 0)])
def test_a_rotation_written_with_three_decimals_is_one(q):
    assert lab(mocap={"q_lab_from_mocap": q}).mocap.q_lab_from_mocap == q


@pytest.mark.parametrize(
    "endpoint",
    ["tcp/[::1]:7447", "udp/lab.local:7447", "tls/host:443#iface=eth0", "unixsock-stream/tmp/bus", "tcp/0.0.0.0:0"],
)
def test_endpoints_that_are_some(endpoint):
    assert lab(link={"zenoh_listen": [endpoint]}).link.zenoh_listen == (endpoint,)


@pytest.mark.parametrize("name", ["../../x", "a/b", "", "..", "a b", "[/]", "<b>", "x\x1b[2J", "a\n", "x" * 65, "**"])
def test_a_name_is_what_may_stand_in_a_path_a_key_and_a_page(name):
    """A body `../../x` wrote its drone's logs outside their folder."""
    wrong = (
        {"leader": {"body": name}},
        {"name": name},
        {"formation": {"shapes": {name: [{"offset_m": (-0.4, 0.0, 0.0)}]}}},
        {"profiles": [{**PAPER_40G.model_dump(), "name": name}]},
    )
    for values in wrong:
        with pytest.raises(ValidationError, match="not a name"):
            lab(**values)
    with pytest.raises(ValidationError, match="unknown control preset"):
        lab(control_preset=name)


def test_a_name_of_letters_digits_dots_and_dashes_is_taken():
    assert lab(name="Room-3_b.2", leader={"body": "x" * 64}).name == "Room-3_b.2"


@pytest.mark.parametrize(("part", "key", "most"), [
    ("mocap", "delay_s", 0.5), ("limits", "tilt_rad", 1.2), ("leader", "sysid", 250),
    ("link", "ground_port_base", 65285), ("link", "drone_port_base", 65285),
])  # fmt: skip
def test_a_lab_is_refused_beyond_its_bounds(part: str, key: str, most: float) -> None:
    def with_value(value: float) -> LabConfig:
        return lab(**{part: {"body": "a", key: value} if part == "leader" else {key: value}})

    assert getattr(getattr(with_value(most), part), key) == most
    for wrong in (most * 1.01, -0.01) if isinstance(most, float) else (most + 1, 0):
        with pytest.raises(ValidationError):
            with_value(wrong)


@pytest.mark.parametrize(("cells", "allowed"), [(0, False), (1, True), (14, True), (15, False)])
def test_a_pack_has_one_to_fourteen_cells(cells: int, allowed: bool) -> None:
    if allowed:
        assert BatteryProfile(cells=cells).cells == cells
    else:
        with pytest.raises(ValidationError):
            BatteryProfile(cells=cells)
