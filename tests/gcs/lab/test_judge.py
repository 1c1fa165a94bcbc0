"""Every fault that a lab file alone decides: found at its exact key, with its reason; what is right is left alone."""

import tomllib

import pytest

from formation.config import LabConfig
from formation.vehicle.profile import PAPER_40G
from gcs.finding import Finding, Grade
from gcs.lab.findings import findings_of
from gcs.lab.judge import judge
from sim.scenario import load, shipped
from wire.config_file import ConfigError, dump, parse

LEADER = {"body": "lead", "sysid": 1, "profile": "paper_40g"}
RIGHT, LEFT = [-0.4, -0.4, 0.0], [-0.4, 0.4, 0.0]


def lab(**changes: object) -> LabConfig:
    values = {"leader": LEADER, "followers": followers(RIGHT, LEFT)}
    return LabConfig.model_validate({**values, **changes})


def followers(*offsets: list[float], **changes: object) -> list[dict[str, object]]:
    names = ("right", "left", "third", "fourth")
    return [
        {"body": name, "sysid": 2 + k, "offset_m": offset, "profile": "paper_40g", **changes}
        for k, (name, offset) in enumerate(zip(names, offsets, strict=False))
    ]


def flies(kind: str = "hold", **trajectory: object) -> dict[str, object]:
    return {**LEADER, "trajectory": {"kind": kind, **trajectory}}


def of(config: LabConfig, grade: Grade) -> dict[str, Finding]:
    return {finding.subject: finding for finding in judge(config) if finding.grade is grade}


FENCE = {"low_m": [-2.5, -2.0, -0.1], "high_m": [2.5, 2.0, 2.3]}
OWN = PAPER_40G.model_dump()
REFUSED: list[tuple[str, dict[str, object], str, str, str]] = [
    ("millimetres", {"followers": followers([-400.0, -0.4, 0.0], LEFT)}, "followers[0].offset_m", "[-400, -0.4, 0]",
     "397.58 m beyond limits.fence.low_m x = -2.5"),
    ("slot in the floor", {"followers": followers([-0.4, -0.4, -0.3], LEFT)}, "followers[0].offset_m",
     "[-0.4, -0.4, -0.3]", "beyond the floor"),
    ("slots too near", {"followers": followers(RIGHT, [-0.4, -0.3, 0.0])}, "followers[1].offset_m", "[-0.4, -0.3, 0]",
     "left would be 0.10 m from right, limits.min_separation_m is 0.2 m"),
    ("slot at the leader", {"followers": followers([0.0, 0.1, 0.0])}, "followers[0].offset_m", "[0, 0.1, 0]",
     "right would be 0.10 m from lead"),
    ("listed shape too near", {"formation": {"shapes": {"s": [{"offset_m": RIGHT}, {"offset_m": [-0.4, -0.5, 0]}]}}},
     "formation.shapes.s[1].offset_m", "[-0.4, -0.5, 0]", "0.10 m from right"),
    ("a name with a dot", {"formation": {"shapes": {"a.b": [{"offset_m": RIGHT}, {"offset_m": [-0.4, -0.5, 0]}]}}},
     "formation.shapes.a.b[1].offset_m", "[-0.4, -0.5, 0]", "0.10 m from right"),
    ("spacing", {"formation": {"spacing_m": 0.15}}, "formation.spacing_m", "0.15", "nearer than limits."),
    ("altitude at the fence", {"flight": {"altitude_m": 2.25}}, "flight.altitude_m", "2.25", "the fence ends at"),
    ("fence above the floor", {"limits": {"fence": {**FENCE, "low_m": [-2.5, -2.0, 0.2]}}}, "limits.fence.low_m",
     "[-2.5, -2, 0.2]", "drones on the floor"),
    ("fence in millimetres", {"limits": {"fence": {"low_m": [-2500, -2000, -1], "high_m": [2500, 2000, 2300]}}},
     "limits.fence.low_m", "[-2500, -2000, -1]", "millimetres"),
    ("start outside", {"leader": {**LEADER, "spawn_lab_m": [0, 3, 0]}}, "leader.spawn_lab_m", "[0, 3, 0]",
     "1.00 m beyond limits.fence.high_m y = 2"),
    ("circle that carries slots out", {"leader": flies("circle", radius_m=1.8)}, "leader.trajectory.radius_m", "1.8",
     "the slot of left is at"),
    ("line that carries a slot out", {"followers": followers([0.6, 0, 0]), "leader": flies("line", length_m=2.0)},
     "leader.trajectory.length_m", "2", "8.0 s along the path the slot of right is at (2.60, 0.00, 0.30) m"),
    ("turn that carries slots out", {"followers": followers([-2.2, 0, 0]), "leader": flies(yaw_rate_rad_s=0.5)},
     "leader.trajectory.yaw_rate_rad_s", "0.5", "turned with the leader"),
    ("waypoints that carry a slot out", {"leader": flies("waypoints", waypoints_m=[[1, 0, 1], [-2.3, 0, 1]])},
     "leader.trajectory.waypoints_m", "[[1, 0, 1], [-2.3, 0, 1]]", "beyond limits.fence.low_m x"),
    ("waypoints too fast", {"leader": flies("waypoints", waypoints_m=[[2, 0, 1]], speed_m_s=4.0)},
     "leader.trajectory.speed_m_s", "4", "limits.speed_m_s is 3"),
    ("more tilt than allowed", {"leader": flies("circle", radius_m=0.5, period_s=1.7), "limits": {"tilt_rad": 0.3}},
     "leader.trajectory.period_s", "1.7", "of what paper_40g reaches under limits.tilt_rad = 0.3"),
    ("more drag than tilt", {"leader": {**flies("circle", radius_m=1.0, period_s=4.0), "profile": "ours"},
                             "profiles": [{**OWN, "name": "ours", "drag_n_s_m": (0.2, 0.2, 0.2)}]},
     "leader.trajectory.period_s", "4", "against 7.85 m/s^2 of drag"),
    ("slots swung too fast", {"followers": followers([-1.8, 0, 0]), "leader": flies(yaw_rate_rad_s=1.8)},
     "leader.trajectory.yaw_rate_rad_s", "1.8", "right would fly at 3.24 m/s"),
    ("degrees a second", {"followers": followers([0.2, 0, 0]), "leader": flies(yaw_rate_rad_s=30.0)},
     "leader.trajectory.yaw_rate_rad_s", "30", "radians are meant"),
    ("an hour", {"leader": flies("circle", period_s=20.0, laps=200)}, "leader.trajectory.laps", "200", "hour"),
    ("climb", {"flight": {"climb_m_s": 4.0}}, "flight.climb_m_s", "4", "limits.speed_m_s is 3"),
    ("grams", {"profiles": [{**OWN, "name": "ours", "mass_kg": 40.0}], "leader": {**LEADER, "profile": "ours"}},
     "profiles[0].mass_kg", "40", "grams?"),
    ("a real drone of no profile",
     {"leader": {"body": "lead", "sysid": 1, "link": "udp:10.0.0.5:14550", "guard": "none"}}, "leader.profile",
     '"paper_40g"', 'Write profile = "..." there: paper_40g, paper_40g_printed, px4_quad'),
    ("two profiles of one name", {"profiles": [{**OWN, "name": "ours"}] * 2, "leader": {**LEADER, "profile": "ours"}},
     "profiles[1].name", '"ours"', "two profiles"),
    ("same link", {"followers": followers(RIGHT, LEFT, link="udp:10.0.0.5:14550", guard="none")}, "followers[1].link",
     '"udp:10.0.0.5:14550"', "right has the same"),
    ("the ground's own port", {"link": {"kind": "udp"}, "followers": [
        followers(RIGHT)[0], {**followers(RIGHT, LEFT)[1], "link": "udpin:127.0.0.1:14541", "guard": "none"}]},
     "followers[1].link", '"udpin:127.0.0.1:14541"', "the ground's own for lead"),
    ("bases that meet", {"link": {"kind": "udp", "drone_port_base": 14541}}, "link.drone_port_base", "14541",
     "UDP port 14542 would be the ground's for right"),
    ("no bus", {"link": {"zenoh_connect": []}}, "link.zenoh_connect", "[]", "finds the ground"),
    ("connect to any port", {"link": {"zenoh_connect": ["tcp/127.0.0.1:0"]}}, "link.zenoh_connect[0]",
     '"tcp/127.0.0.1:0"', "port 0"),
    ("endpoint twice", {"link": {"zenoh_connect": ["tcp/a:1", "tcp/a:1"]}}, "link.zenoh_connect",
     '["tcp/a:1", "tcp/a:1"]', "2 times"),
    ("few frames", {"mocap": {"rate_hz": 5.0}}, "mocap.rate_hz", "5", "no setpoint comes for 0.1 s"),
    ("kilohertz", {"mocap": {"rate_hz": 100_000.0}}, "mocap.rate_hz", "100000", "no mocap is as fast"),
    ("drones start in one place", {"followers": followers(RIGHT, LEFT, spawn_lab_m=[1, 0, 0])},
     "followers[1].spawn_lab_m", "[1, 0, 0]", "left starts 0.00 m from right"),
    ("a drone starts outside", {"followers": followers(RIGHT, spawn_lab_m=[5, 0, 0])},
     "followers[0].spawn_lab_m", "[5, 0, 0]", "would not arm"),
    ("heading in degrees", {"followers": followers(RIGHT, LEFT, yaw_offset_rad=90.0)}, "followers[0].yaw_offset_rad",
     "90", "radians are meant"),
    ("behind an observed leader", {"leader": {"body": "lead"}, "followers": followers([-400.0, 0, 0])},
     "followers[0].offset_m", "[-400, 0, 0]", "farther from the leader than the fence is wide"),
    ("an unknown body's name", {"mocap": {"source": "vrpn", "names": {"A": "wand"}}}, "mocap.names", "", "wand is"),
    ("wider than apart", {"leader": {**LEADER, "profile": "px4_quad"}}, "limits.min_separation_m", "0.2",
     "0.43 m wide"),
    ("downwash that it cannot carry", {"profiles": [{**OWN, "name": "ours", "thrust_max_n": 0.46}],
     "followers": followers(RIGHT, [-0.4, -0.4, 0.6], profile="ours")}, "followers[0].offset_m", "[-0.4, -0.4, 0]",
     "beyond hovering it has thrust for 17%"),
    ("more than the whole", {"mocap": {"latency_s": 0.02}}, "mocap.latency_s", "0.02", "a part of delay_s"),
]  # fmt: skip
WARNED: list[tuple[str, dict[str, object], str, str]] = [
    ("observed", {"leader": {"body": "lead"}}, "leader.body", "only observed"),
    ("floor on the fence", {"limits": {"fence": {**FENCE, "low_m": [-2.5, -2, 0]}}}, "limits.fence.low_m", "stand and"),
    ("ground effect", {"flight": {"altitude_m": 0.2}}, "flight.altitude_m", "ground effect"),
    ("fast descent", {"flight": {"descend_m_s": 2.0}}, "flight.descend_m_s", "downwash"),
    ("near", {"followers": followers(RIGHT, [-0.4, -0.65, 0])}, "followers[1].offset_m", "brake for each other"),
    ("no profile", {"leader": {"body": "lead", "sysid": 1}}, "leader.profile", "flown as paper_40g, a vehicle of 40 g"),
    ("several profiles", {"leader": {**LEADER, "profile": "crazyflie_27g"}}, "followers[0].profile",
     "several profiles"),
    ("no kind", {"leader": {**LEADER, "trajectory": {"radius_m": 0.5}}}, "leader.trajectory.kind", "holds its place"),
    ("another kind's key", {"leader": flies("line", radius_m=0.5)}, "leader.trajectory.radius_m", "does not use it"),
    ("laps or duration", {"leader": flies("circle", laps=2, duration_s=9.0)}, "leader.trajectory.duration_s", "laps"),
    ("an observed leader's", {"leader": {"body": "lead", "trajectory": {"kind": "line"}}}, "leader.trajectory.kind",
     "flies what it flies"),
    ("raised above nobody", {"flight": {"observed_leader_altitude_offset_m": 0.5}},
     "flight.observed_leader_altitude_offset_m", "the leader is commanded"),
    ("slow frames", {"mocap": {"rate_hz": 30.0}}, "mocap.rate_hz", "control cycle"),
    ("late poses", {"mocap": {"delay_s": 0.2}}, "mocap.delay_s", "seconds are meant"),
    ("another system's table", {"mocap": {"source": "vrpn", "vrpn": {"host": "10.0.0.1"}, "natnet": {}}},
     "mocap.natnet", '"vrpn"'),
    ("nothing to assemble", {"mocap": {"assemble_s": 0.002}}, "mocap.assemble_s", "whole frames"),
    ("names for nobody", {"mocap": {"names": {"A": "lead"}}}, "mocap.names", "as the lab does"),
    ("nothing guards it", {"leader": {**LEADER, "profile": "px4_quad", "link": "udp:127.0.0.1:14550", "guard": "none"},
                           "followers": followers(RIGHT, LEFT, profile="px4_quad"),
                           "limits": {"min_separation_m": 0.43}}, "leader.guard", "COM_OBL_RC_ACT"),
    ("a link to nobody", {"leader": {"body": "lead", "link": "udp:10.0.0.5:14550", "guard": "none"}}, "leader.link",
     "nothing is sent"),
    ("a profile for nobody", {"profiles": [{**OWN, "name": "ours"}]}, "profiles[0].name", "no vehicle names"),
    ("heavy", {"profiles": [{**OWN, "name": "ours", "mass_kg": 0.075}], "leader": {**LEADER, "profile": "ours"}},
     "profiles[0].thrust_max_n", "1.09 times its weight"),
    ("much tilt", {"leader": flies("circle", radius_m=0.5, period_s=2.0)}, "leader.trajectory.period_s", "% of what"),
    ("little room", {"followers": followers([-2.41, 0, 0])}, "limits.fence", "right comes within 0.09 m"),
    ("a hall", {"limits": {"fence": {"low_m": [-200, -2, -1], "high_m": [2, 2, 2]}}}, "limits.fence.low_m", "metres"),
    ("slow descent", {"flight": {"descend_m_s": 0.005}}, "flight.descend_m_s", "longer than a minute"),
    ("downwash", {"followers": followers(RIGHT, [-0.4, -0.4, 0.6])}, "followers[0].offset_m", "right would fly 0.60 m "
     "under left, whose downwash takes 19% of its weight; half of that 1.51 m under it"),
    ("downwash of two on the leader", {"followers": followers([0, 0, 0.4], [0, 0, 0.8])}, "followers[0].offset_m",
     "lead would fly 0.40 m under right and 1 more, whose downwash takes 38%"),
    ("downwash on the way", {"followers": [
        f | {"spawn_lab_m": m} for f, m in zip(followers([-0.4, -0.4, 0.3], LEFT), (LEFT, RIGHT), strict=True)]},
     "followers[1].offset_m", "left would pass, on its way into its slot, 0.15 m under right"),
    ("shapes that do not fit", {"formation": {"spacing_m": 2.2}}, "formation.spacing_m", "line, column would leave"),
    ("longer than a battery", {"leader": flies("circle", laps=30)}, "leader.trajectory.laps", "hovers for about 315 s"),
    ("played leader", {"mocap": {"source": "csv", "file": "x"}}, "mocap.source", "of the leader alone"),
    ("a file for nobody", {"mocap": {"file": "x.csv"}}, "mocap.file", "nothing is played"),
    ("a shipped name", {"profiles": [OWN]}, "profiles[0].name", "replaces the shipped"),
]  # fmt: skip
REAL = {"link": "udp:192.168.1.31:14550", "guard": "none", "profile": "px4_quad"}
VICON = {"source": "vicon", "vicon": {"host": "192.168.1.10"}}
OURS_TOO = {"name": "ours", "base": "px4_quad"}
MISTAKES: list[tuple[str, dict[str, object], str]] = [
    ("a sysid twice", {"followers": followers(RIGHT, LEFT, sysid=2)}, "followers[1].sysid"),
    ("the ground's sysid", {"followers": followers(RIGHT, sysid=255)}, "followers[0].sysid"),
    ("a body twice", {"followers": followers(RIGHT, LEFT, body="right")}, "followers[1].body"),
    ("names the wrong way round", {"mocap": {**VICON, "names": {"lead": "Quad 1"}}}, "mocap.names.lead"),
    ("a link without a port", {"followers": followers(RIGHT, **REAL | {"link": "udp:10.0.0.1"})}, "followers[0].link"),
    ("a serial link of the ground's", {"leader": LEADER | REAL | {"link": "serial:/dev/ttyUSB0:57600"}}, "leader.link"),
    ("a link to an address that is none", {"leader": LEADER | REAL | {"link": "udp:192.168.1.333:1"}}, "leader.link"),
    ("no host of the cameras", {"mocap": {"source": "vicon"}}, "mocap.vicon.host"),
    ("a host with its port", {"mocap": {**VICON, "vicon": {"host": "192.168.1.10:801"}}}, "mocap.vicon.host"),
    ("a misspelt table", {"mocap": {**VICON, "vcion": {}}}, "mocap.vcion"),
    ("left-handed axes", {"mocap": {"axes": ["x forward", "y right", "z up"]}}, "mocap.axes"),
    ("a unit that Vicon does not send", {"mocap": {**VICON, "unit": "m"}}, "mocap.unit"),
    ("an origin in millimetres", {"mocap": {"origin_lab_m": [1500.0, 0.0, 0.0]}}, "mocap.origin_lab_m"),
    ("w last", {"leader": {**LEADER, "q_marker_from_flu": [0.0, 0.0, 0.0, 1.0]}}, "leader.q_marker_from_flu"),
    ("a marker frame on its side", {"leader": {**LEADER, "q_marker_from_flu": [0.7071, 0.7071, 0.0, 0.0]}},
     "leader.q_marker_from_flu"),
    ("height with z down", {"flight": {"altitude_m": -1.0}}, "flight.altitude_m"),
    ("a point without z", {"leader": flies("waypoints", waypoints_m=[[1.0, 0.0]])},
     "leader.trajectory.waypoints_m[0][2]"),
    ("a file that is not there", {"leader": flies("file", file="path.csv")}, "leader.trajectory.file"),
    ("a misspelt key", {"flight": {"clim_m_s": 0.4}}, "flight.clim_m_s"),
    ("more than the autopilot sends", {"link": {"imu_rate_hz": 1000.0}}, "link.imu_rate_hz"),
    ("a number in quotes", {"mocap": {"vicon": {"port": "801"}}}, "mocap.vicon.port"),
    ("a flag in quotes", {"mocap": {"vrpn": {"udp": "no"}}}, "mocap.vrpn.udp"),
    ("a letter in an address", {"link": {"zenoh_connect": ["tcp/127.0.0.l:7447"]}}, "link.zenoh_connect[0]"),
    ("a broadcast for a multicast", {"mocap": {"natnet": {"multicast": "192.168.1.255"}}}, "mocap.natnet.multicast"),
    ("the server's address for our own", {"mocap": {"natnet": {"host": "10.0.0.2", "interface": "10.0.0.2"}}},
     "mocap.natnet.interface"),
    ("another kind's key with its usual value", {"leader": flies("line", radius_m=0.3)}, "leader.trajectory.radius_m"),
    ("a stop button that is not there", {"operator": {"stop_button": {"device": "/dev/nobody"}}},
     "operator.stop_button.device"),
    ("no fence of a real room", {"leader": LEADER | REAL}, "limits.fence"),
    ("a wheelbase in millimetres", {"profiles": [OURS_TOO | {"wheelbase_m": 300}]}, "profiles[0].wheelbase_m"),
    ("a mass in grams", {"profiles": [OURS_TOO | {"mass_kg": 1000}]}, "profiles[0].mass_kg"),
    ("a base that is not shipped", {"profiles": [OURS_TOO | {"base": "x5000"}]}, "profiles[0].base"),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "key"), [case[1:] for case in MISTAKES], ids=[c[0] for c in MISTAKES])
def test_a_mistake_is_found_at_its_key(changes, key: str) -> None:
    """Whether one field shows it as the file is read, or the lab as a whole."""
    values = {"leader": LEADER, "followers": followers(RIGHT, LEFT), **changes}
    try:
        keys = {found.subject for found in findings_of(parse(values, LabConfig, source="lab.toml"))}
    except ConfigError as error:
        keys = {fault.key for fault in error.faults}
    assert key in keys


@pytest.mark.parametrize(
    ("changes", "key", "value", "words"), [case[1:] for case in REFUSED], ids=[c[0] for c in REFUSED]
)
def test_a_fault_is_rejected_at_its_key(changes, key: str, value: str, words: str) -> None:
    refusals = [f for f in judge(lab(**changes)) if f.grade is Grade.FAIL and f.subject == key]
    assert any(words in f.why for f in refusals), judge(lab(**changes))
    assert {f.found for f in refusals} == {value}


@pytest.mark.parametrize(("changes", "key", "words"), [case[1:] for case in WARNED], ids=[c[0] for c in WARNED])
def test_a_doubtful_value_is_warned_of_and_not_rejected(changes, key: str, words: str) -> None:
    config = lab(**changes)
    warnings = [f for f in judge(config) if f.grade is Grade.WARN and f.subject == key]
    assert any(words in f.why for f in warnings), judge(config)
    assert of(config, Grade.FAIL) == {}


def test_a_plain_lab_is_neither_rejected_nor_warned_of() -> None:
    assert judge(lab()) == ()
    written = parse(tomllib.loads(dump(lab())), LabConfig, source="lab.toml")  # by a program, every key in it
    assert of(written, Grade.FAIL) == {}


def test_each_fault_is_reported_once_and_from_where_the_leader_starts() -> None:
    """An altitude above the fence is not told again of every slot, nor a circle too large of every slot it carries."""
    assert list(of(lab(flight={"altitude_m": 3.0}), Grade.FAIL)) == ["flight.altitude_m"]
    circle = flies("circle", radius_m=30.0, period_s=600.0)
    assert list(of(lab(leader=circle), Grade.FAIL)) == ["leader.trajectory.radius_m"]
    ahead = followers([-3.0, 0.0, 0.0])
    assert list(of(lab(followers=ahead), Grade.FAIL)) == ["followers[0].offset_m"]
    assert of(lab(followers=ahead, leader={**LEADER, "spawn_lab_m": [1.0, 0.0, 0.0]}), Grade.FAIL) == {}


@pytest.mark.parametrize("name", sorted(shipped()))
def test_no_shipped_scenario_is_rejected(name: str) -> None:
    assert of(load(name).lab, Grade.FAIL) == {}


def test_every_trajectory_that_may_be_chosen_is_judged_by_its_own_key() -> None:
    ways = {
        "far": {"kind": "circle", "radius_m": 30.0},
        "odd": {"kind": "line", "radius_m": 0.5},
        "good": {"kind": "circle", "radius_m": 0.4},
    }
    summary = {finding.subject: finding for finding in judge(lab(leader=LEADER | {"trajectories": ways}))}
    assert summary["leader.trajectories.far.radius_m"].grade is Grade.FAIL
    assert summary["leader.trajectories.far.radius_m"].found == "30"
    assert summary["leader.trajectories.odd.radius_m"].grade is Grade.WARN
    assert not any("good" in subject for subject in summary)
