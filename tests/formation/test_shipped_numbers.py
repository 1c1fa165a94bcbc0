"""The numbers that flights depend on, as they were tuned, measured or printed: none changes by the way."""

from collections.abc import Iterator
from dataclasses import astuple

import pytest
from pydantic import ValidationError

from formation.config import FollowerConfig, LabConfig, LeaderConfig
from formation.control.gains import Law
from formation.control.presets import PRESETS
from formation.vehicle.profile import PROFILES, BatteryProfile, GainScale


def numbers(value: object) -> Iterator[object]:
    """Everything but names in a nest of tuples."""
    if isinstance(value, tuple):
        for part in value:
            yield from numbers(part)
    elif not isinstance(value, str):
        yield value


HORIZONTAL = (Law.CFC, 4.0, 4.1, 0.59, -0.177, 0.027, 0.0)  # c, p1, p2, eps, rounding, k
UPWARDS = (Law.CFC, 8.0, 10.0, 0.0, -0.15, 0.35, 0.0)
PRINTED_UPWARDS = (Law.CFC, 8.0, 10.0, 3.0, -0.15, 0.35, 0.0)
OURS = (12.3, -0.029, 0.004, 1.0)  # w, a, e0, rounding
LEAD, FIRM, AS_IS = (0.85, 0.9, 0.32, 0.9, 0.28), (1.2, 1.64, 0.255, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0, 0.0)
SHARES = (1.0, 1.0, 2.0, 0.13)  # of dead time and lag, thrust's lag, trust in the attitude
FAST, ALONE = (168.0, 6.3, 8.8, 13.1, 0.56, 4.4, 0.1), (0.0, 8.0, 8.0, 8.0, 1.0, 1.0, 0.1)
FAST_HEADING = (60.0, 8.0, 11.0, 5.0, 1.0, 1.0, 0.6)
PID_ROW, CALM_OBSERVER = (2.0, 4.0, 1.0, 0.0), (18.0, -0.1, 0.004, 1.0)


def preset_row(
    follower=HORIZONTAL, leader=HORIZONTAL, compensate=True, observer=OURS, own=OURS,
    shares=SHARES, parallel=FAST, follower_lead=LEAD, leader_lead=LEAD, upwards=UPWARDS,
) -> list:  # fmt: skip
    return list(numbers((
        follower, upwards, leader, upwards, compensate, observer, own,
        (15.0, -0.1, 0.004, 1.0), (8.0, -0.1, 0.02, 1.0),  # height, heading
        (12.0, -0.1, 0.004, 1.0), (20.0, -0.1, 0.004, 1.0), (2.4, -0.1, 0.01, 1.0),  # of a leader only observed
        shares, 18.0, 11.2, 2e-4, 1e-3,  # tilt filter, its decay, noise in m and rad
        (0.117, 1.55, 6.1), parallel, FAST_HEADING, follower_lead, leader_lead,
    )))  # fmt: skip


PRINTED = {"leader": PID_ROW, "own": CALM_OBSERVER, "shares": (0.9, 0.62, 2.0, 0.65), "parallel": ALONE,
           "follower_lead": AS_IS, "leader_lead": AS_IS, "compensate": False, "upwards": PRINTED_UPWARDS}  # fmt: skip
BEHIND_PID = {"leader": PID_ROW, "own": CALM_OBSERVER, "leader_lead": AS_IS}
ISTSMC = (Law.ISTSMC, 1.0, 8.0, 0.1, -0.49, 0.0, 0.0)
EXPECTED = {
    "default": preset_row(),
    "pid_leader": preset_row(**BEHIND_PID),
    "paper": preset_row((Law.CFC, *ISTSMC[1:]), observer=(70.0, -2.0 / 9.0, 1.0, 0.0), **PRINTED),
    "paper_istsmc": preset_row(ISTSMC, observer=CALM_OBSERVER, **PRINTED),
    "paper_smc": preset_row((Law.SMC, 1.0, 0.0, 0.0, 0.0, 0.0, 5.0), observer=CALM_OBSERVER, **PRINTED),
    "pid": preset_row((4.4, 13.4, 1.0, 0.0), **BEHIND_PID, follower_lead=FIRM),
    "geometric": preset_row((50.8, 14.3, 4.0, 1.5, 1.0), **BEHIND_PID, follower_lead=FIRM),
}


@pytest.mark.parametrize("name", PRESETS)
def test_the_gains_are_those_that_were_tuned_or_printed(name: str) -> None:
    assert list(numbers(astuple(PRESETS[name]))) == pytest.approx(EXPECTED[name])
    assert PRESETS[name].name == name


PAPERS = [0.12, 0.025, 0.8, 0.5, 0.01, 0.025, 0.006, 0.006, 0.008, 1.0,
          11.0, 5.0, 35.0, 12.0, 10.0, 3.5, True, 0.002, 0.049, 0.049, 0.01, 0.025]  # fmt: skip
MEASURED = {  # as VehicleProfile's fields follow each other, without name and battery
    "paper_40g": [0.04, 1.532e-5, 1.532e-5, 2.9e-5, False, *PAPERS],
    "paper_40g_printed": [0.04, 1.532e-4, 1.532e-4, 3.472e-4, True, *PAPERS],
    "px4_quad": [1.0, 0.005, 0.005, 0.009, False, 0.3, 0.0635, 20.0, 0.0, 0.05, 0.02, 1.0, 1.0, 1.0, 1.0,
                 11.0, 4.0, 45.0, 12.0, 3.8, 3.5, False, 0.08, 0.11, 0.06, 0.08, 0.02],
    "arducopter_quad": [3.0, 0.023, 0.023, 0.046, False, 0.35, 0.175, 79.5, 0.0, 0.05, 0.02, 0.7, 0.7, 0.7, 1.0,
                        6.7, 6.7, 29.0, 12.0, 10.0, 3.5, True, 0.01, 0.055, 0.108, 0.02, 0.02],
    "crazyflie_27g": [0.027, 2.3951e-5, 2.3951e-5, 3.2347e-5, False, 0.092, 0.0231, 0.596, 0.57, 0.006, 0.03,
                      0.0056, 0.0056, 0.0063, 1.0, 6.0, 6.0, 35.0, 12.0, 10.0, 3.5, False,
                      0.005, 0.048, 0.124, 0.01, 0.03],
    "quad_250g": [0.25, 0.00026, 0.00026, 0.00047, False, 0.16, 0.038, 7.4, 0.5, 0.01, 0.025, 0.04, 0.04, 0.05, 1.0,
                  6.5, 2.8, 35.0, 12.0, 3.8, 3.5, False, 0.01, 0.052, 0.113, 0.02, 0.025],
    "x500": [2.0, 0.0217, 0.0217, 0.04, False, 0.5, 0.127, 34.2, 1.0, 0.016, 0.025, 0.3, 0.3, 0.3, 1.0,
             6.5, 2.8, 25.0, 8.0, 3.8, 3.5, False, 0.01, 0.065, 0.102, 0.02, 0.025],
}  # fmt: skip
PACKS = {
    "paper_40g": (1, 350.0, 4.0, 0.85),
    "paper_40g_printed": (1, 350.0, 4.0, 0.85),
    "px4_quad": (4, 3300.0, 12.0, 0.85),
    "arducopter_quad": (3, 3300.0, 12.0, 0.85),
    "crazyflie_27g": (1, 250.0, 2.1, 0.85),
    "quad_250g": (3, 650.0, 5.0, 0.85),
    "x500": (4, 5000.0, 16.0, 0.85),
}


@pytest.mark.parametrize("name", PROFILES)
def test_the_vehicles_are_those_that_were_measured(name: str) -> None:
    held = PROFILES[name].model_dump(exclude={"name", "battery", "gain_scale"})
    assert list(numbers(tuple(held.values()))) == pytest.approx(MEASURED[name])
    assert tuple(PROFILES[name].battery.model_dump().values()) == PACKS[name]
    assert PROFILES[name].gain_scale is None


def test_a_lab_that_says_little_is_the_papers_room() -> None:
    lab = LabConfig(
        leader=LeaderConfig(body="a", sysid=1), followers=(FollowerConfig(body="b", sysid=2, offset_m=(1.0, 0.0, 0.0)),)
    )  # fmt: skip
    fence, limits, flight, path, mocap = lab.limits.fence, lab.limits, lab.flight, lab.leader.trajectory, lab.mocap
    assert (fence.low_m, fence.high_m) == ((-2.5, -2.0, -0.1), (2.5, 2.0, 2.3))
    assert (limits.tilt_rad, limits.speed_m_s, limits.min_separation_m) == (0.6, 3.0, 0.2)
    assert (flight.altitude_m, flight.climb_m_s, flight.descend_m_s, flight.formation_change_m_s) == (
        0.3,
        0.4,
        0.3,
        0.5,
    )
    assert flight.observed_leader_altitude_offset_m == 0.0
    assert (path.length_m, path.radius_m, path.period_s, path.duration_s, path.speed_m_s) == (1.0, 0.3, 12.0, 8.0, 0.5)
    assert (path.yaw_rate_rad_s, path.waypoints_m, path.laps) == (0.0, (), None)
    assert (mocap.rate_hz, mocap.delay_s, mocap.origin_lab_m) == (100.0, 0.008, (0.0, 0.0, 0.0))
    assert mocap.q_lab_from_mocap == lab.leader.q_marker_from_flu == (1.0, 0.0, 0.0, 0.0)
    assert (lab.leader.spawn_lab_m, lab.leader.spawn_yaw_rad) == ((0.0, 0.0, 0.0), 0.0)
    assert (lab.formation.spacing_m, lab.followers[0].yaw_offset_rad) == (0.5, 0.0)
    assert (lab.link.ground_port_base, lab.link.drone_port_base) == (14540, 14580)
    assert lab.origin == (47.397742, 8.545594, 488.0)
    assert lab.commanded == (0, 1)
    assert tuple(BatteryProfile().model_dump().values()) == (1, 350.0, 4.0, 0.85)
    assert set(GainScale().model_dump().values()) == {1.0}


@pytest.mark.parametrize(("part", "key", "most"), [
    ("mocap", "delay_s", 0.5), ("limits", "tilt_rad", 1.2), ("leader", "sysid", 250),
    ("link", "ground_port_base", 65285), ("link", "drone_port_base", 65285),
])  # fmt: skip
def test_a_lab_is_refused_beyond_its_bounds(part: str, key: str, most: float) -> None:
    followers = [{"body": "b", "sysid": 2, "offset_m": (-0.4, 0.0, 0.0)}]

    def lab(value: float) -> LabConfig:
        values = {"followers": followers, "leader": {"body": "a"}}
        return LabConfig.model_validate({**values, part: {**values.get(part, {}), key: value}})

    assert getattr(getattr(lab(most), part), key) == most
    with pytest.raises(ValidationError):
        lab(most * 1.01 if isinstance(most, float) else most + 1)
    with pytest.raises(ValidationError):
        lab(-0.01 if isinstance(most, float) else 0)


@pytest.mark.parametrize(("cells", "allowed"), [(0, False), (1, True), (14, True), (15, False)])
def test_a_pack_has_one_to_fourteen_cells(cells: int, allowed: bool) -> None:
    if allowed:
        assert BatteryProfile(cells=cells).cells == cells
    else:
        with pytest.raises(ValidationError):
            BatteryProfile(cells=cells)
