"""Vehicles whose truth is known: made by hand, and flown in the simulator."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import curve_fit

from analysis.identify import drag, response, thrust
from analysis.identify.drag import Drag
from analysis.identify.report import to_json
from analysis.identify.response import Response, nearest_first_order
from analysis.identify.sensing import Sensing, attitudes_of, estimate_sensing, late, scatter
from analysis.identify.signals import Estimate, Seen, Sent, propagated
from analysis.identify.thrust import Thrust
from analysis.identify.vehicle import KNOWN_WITHIN, Identification, identify
from analysis.load import Flight, from_records
from drone_agent.guard.position import LoopSetpoint
from drone_agent.simulation.attitude_loop import advance
from formation.maths import frames
from formation.maths.arrays import Float
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import PROFILES, VehicleProfile, at_rest
from sim import lockstep, scenario
from wire import config_file

FINE_S = 0.0005


def covers(estimate: Estimate, truth: float) -> bool:
    """Within three standard deviations, or nearer than the test integrator is exact."""
    reach = 1.5 * estimate.half_width
    return abs(estimate.value - truth) <= max(reach, 0.02 * abs(truth))


def commanded(seconds: float, rng: np.random.Generator) -> tuple[Float, Float]:
    """Jittered times and a lively tilt (two axes), rad."""
    t_s = np.cumsum(0.01 + 0.0005 * rng.standard_normal(round(100 * seconds)))
    steps = np.repeat(0.06 * rng.standard_normal((len(t_s) // 20 + 1, 2)), 20, axis=0)[: len(t_s)]
    return t_s, steps + 0.02 * rng.standard_normal((len(t_s), 2))


def attitude_loop(t_s: Float, target: Float, at_s: Float, p: float, r: float, motor_s: float, delay_s: float) -> Float:
    """Cascaded attitude loop integrated in small steps: torque lags, rate loop, attitude P."""
    angle, rate, torque = np.zeros(2), np.zeros(2), np.zeros(2)
    index = np.clip(np.searchsorted(t_s + delay_s, at_s, side="right") - 1, -1, None)
    out = np.empty((len(at_s), 2))
    for k, i in enumerate(index):
        out[k] = angle
        wanted = target[i] if i >= 0 else np.zeros(2)
        torque = torque + FINE_S * (r * (p * (wanted - angle) - rate) - torque) / motor_s
        rate = rate + FINE_S * torque
        angle = angle + FINE_S * rate
    return out


def level(lean: Float) -> Float:
    """Attitudes whose up axis leans so."""
    return frames.from_rotation_vector(np.stack([-np.arcsin(lean[:, 1]), np.arcsin(lean[:, 0]), 0 * lean[:, 0]], -1))


NIGHTLY = pytest.param(11.0, 35.0, 0.025, 0.006, marks=pytest.mark.nightly)


@pytest.mark.parametrize(("p", "r", "motor_s", "delay_s"), [(7.0, 50.0, 0.02, 0.08), NIGHTLY])
def test_a_cascaded_loop_is_found_again(p: float, r: float, motor_s: float, delay_s: float):
    rng = np.random.default_rng(1)
    t_s, tilt = commanded(20.0, rng)
    fine_s = np.arange(t_s[0], t_s[-1], FINE_S)
    lean = attitude_loop(t_s, np.sin(tilt), fine_s, p, r, motor_s, delay_s)
    looked_s = np.arange(t_s[0] + 0.5, t_s[-1], 0.01)
    trim = np.array([0.004, -0.002])
    noisy = np.stack([np.interp(looked_s, fine_s, lean[:, i]) for i in range(2)], 1) + trim
    noisy += 0.001 * rng.standard_normal(noisy.shape)
    flat = np.zeros(len(looked_s))
    saw = Seen(looked_s, flat, noisy, flat + 1.0, flat, noisy)
    of = Sent(t_s, level(np.sin(tilt)), np.zeros((len(t_s), 3)), np.full(len(t_s), 0.5))
    found = response.fit(of, saw)
    assert isinstance(found, Response)
    assert covers(found.attitude_p_1_s, p)
    assert covers(found.rate_p_1_s, r)
    assert covers(found.motor_lag_s, motor_s)
    assert found.delay_s.value == pytest.approx(delay_s, abs=0.001)
    assert found.rate_lead is None
    assert covers(found.tilt_share, 1.0)
    reached = replace(saw, tilt=0.8 * saw.tilt)
    less = response.fit(of, reached)
    assert isinstance(less, Response)
    assert less.tilt_share.value == pytest.approx(0.8, abs=0.03)


def test_a_first_order_response_is_its_own_nearest():
    """A loop whose inner lags vanish is a first-order lag of 1/P."""
    parameters = np.array([np.log(8.0), np.log(400.0), np.log(0.002), 0.03, 0.0, 0.0, 0.0])
    dead_s, lag_s = nearest_first_order(parameters)
    assert lag_s == pytest.approx(1.0 / 8.0, rel=0.03)
    assert dead_s == pytest.approx(0.03 + 1.0 / 400.0, abs=0.002)


def test_thrust_and_its_curve_are_found_again():
    """A climb and a descent with 0.1 mm of noise: hover, curve and the battery's fade."""
    rng = np.random.default_rng(2)
    curve, full, delay_s, motor_s, fade = 0.4, 21.0, 0.01, 0.025, 0.0006
    t_s = np.arange(0.0, 30.0, 0.01)
    norm = 0.6 + 0.04 * np.sin(1.7 * t_s) * np.sin(0.3 * t_s)
    fine_s = np.arange(0.0, 30.0, FINE_S)
    index = np.clip(np.searchsorted(t_s + delay_s, fine_s, side="right") - 1, 0, None)
    force = full * ((1.0 - curve) * norm[index] + curve * norm[index] ** 2)
    reached = np.empty_like(force)
    reached[0] = force[0]
    for k in range(1, len(force)):
        reached[k] = reached[k - 1] + FINE_S * (force[k - 1] - reached[k - 1]) / motor_s
    acc = reached * (1.0 - fade * fine_s) - GRAVITY_M_S2
    z = 1.0 + np.cumsum(np.cumsum(acc) * FINE_S) * FINE_S
    height = np.interp(t_s, fine_s, z) + 1e-4 * rng.standard_normal(len(t_s))
    flat = np.zeros(len(t_s))
    of = Sent(t_s, np.tile(frames.IDENTITY, (len(t_s), 1)), np.zeros((len(t_s), 3)), norm)
    found = thrust.fit(
        of, Seen(t_s, height, np.zeros((len(t_s), 2)), flat + 1.0, flat, np.zeros((len(t_s), 2))), delay_s, motor_s
    )
    assert isinstance(found, Thrust)
    hover = (-(1.0 - curve) + np.sqrt((1.0 - curve) ** 2 + 4.0 * curve * GRAVITY_M_S2 / full)) / (2.0 * curve)
    assert found.hover_norm.value == pytest.approx(hover, rel=0.003)
    assert found.curve is not None
    assert covers(found.curve, curve)
    assert found.fade_1_s.value == pytest.approx(fade, rel=0.1)


def test_drag_and_the_tilt_of_the_markers_are_found_in_the_poses_alone():
    """An eight with a turning heading, 0.1 mm and 1 mrad of noise; the lean is the one that the motion asks for."""
    rng = np.random.default_rng(4)
    t_s, drag_1_s, trim = np.arange(0.0, 30.0, 0.01), 0.4, np.array([0.03, -0.02])
    place = np.stack([np.sin(1.1 * t_s), 0.5 * np.sin(2.2 * t_s)], axis=1)
    speed = np.stack([1.1 * np.cos(1.1 * t_s), 1.1 * np.cos(2.2 * t_s)], axis=1)
    slope = (drag_1_s * speed - np.array([1.21, 4.84]) * place) / GRAVITY_M_S2
    cos, heading = 1.0 / np.sqrt(1.0 + np.square(slope).sum(axis=1)), 0.4 * t_s
    turned = np.stack([np.cos(heading) * trim[0] - np.sin(heading) * trim[1],
                       np.sin(heading) * trim[0] + np.cos(heading) * trim[1]], axis=1)  # fmt: skip
    lean = slope * cos[:, None] + turned + 1e-3 * rng.standard_normal(slope.shape)
    noisy = place + 1e-4 * rng.standard_normal(place.shape)
    found = drag.fit(Seen(t_s, np.ones(len(t_s)), lean, cos, heading, noisy))
    assert isinstance(found, Drag)
    assert covers(found.drag_1_s, drag_1_s)
    assert covers(found.trim_x, trim[0])
    assert covers(found.trim_y, trim[1])
    assert drag.fit(Seen(t_s[:9], np.ones(9), lean[:9], cos[:9], heading[:9], noisy[:9])) == drag.TOO_SHORT


def test_pose_noise_is_told_from_motion_at_uneven_times():
    rng = np.random.default_rng(3)
    t_s = np.cumsum(0.01 + 0.001 * rng.standard_normal(4000))
    moving = np.stack([np.sin(t_s), 1.5 * t_s, 0.3 * np.cos(3.0 * t_s)], axis=1)
    found = scatter(t_s, moving + 2e-4 * rng.standard_normal(moving.shape))
    assert found is not None
    assert found.value == pytest.approx(2e-4, rel=0.05)
    assert scatter(t_s[:20], moving[:20]) is None


def test_uncertainty_is_carried_through_a_function():
    (product,) = propagated(lambda x: np.array([x[0] * x[1]]), np.array([2.0, 3.0]), np.diag([0.01, 0.04]))
    assert product.value == 6.0
    assert product.half_width == pytest.approx(1.96 * np.sqrt(9.0 * 0.01 + 4.0 * 0.04), rel=1e-4)


SLOW = {"attitude_p_1_s": 8.0, "rate_p_1_s": 28.0, "command_delay_s": 0.012, "thrust_curve": 0.3, "mass_kg": 0.046}


@pytest.fixture(scope="module")
def flown() -> Flight:
    """A short flight of one follower that is not what its profile says, from the simulator."""
    plan = scenario.load("triangle_circle")
    lab = plan.lab.model_copy(update={"followers": plan.lab.followers[:1]})
    trajectory = lab.leader.trajectory.model_copy(update={"duration_s": 12.0, "period_s": 6.0})
    lab = lab.model_copy(update={"leader": lab.leader.model_copy(update={"trajectory": trajectory})})
    true = scenario.TrueVehicle(sysid=2, vehicle=SLOW)
    _, records = lockstep.run_in_memory(
        plan.model_copy(update={"lab": lab, "formation_s": 12.0, "vehicles": (true,)}), 5
    )
    return from_records(lockstep.metadata(plan, 5, "memory", 0) | {"lab": lab.model_dump_json()}, records)


@pytest.fixture(scope="module")
def found(flown: Flight) -> Identification:
    return identify(flown)


def step_truth(body: VehicleProfile) -> tuple[float, float]:
    """Dead time and lag of the vehicle's own step, as control's profiles state them."""
    tilt = 0.05
    target = LoopSetpoint(frames.from_rotation_vector(np.array([0.0, tilt, 0.0])), np.zeros(3), body.hover_thrust_norm)
    state, angles = at_rest(np.array([0.0, 0.0, 5.0]), frames.IDENTITY, body.weight_n / 4.0), []
    for _ in range(round(4.4e3 / body.attitude_p_1_s)):
        state = advance(state, body, target, True, np.zeros(3), 0.001, 1)
        angles.append(2.0 * np.arcsin(state.q_lab_from_flu[2]) / tilt)
    (dead_s, lag_s), _ = curve_fit(response.first_order, 0.001 * np.arange(1, len(angles) + 1), angles, p0=(0.05, 0.05))
    return dead_s, lag_s


def test_a_flown_vehicles_lag_delay_and_hover_thrust_are_found(found: Identification):
    """Within 10 % (lag, dead time) and 2 % (hover), the drone being unlike the profile it was flown with."""
    follower = found.drones[1]
    body = VehicleProfile.model_validate(PROFILES["paper_40g"].model_dump() | SLOW)
    dead_s, lag_s = step_truth(body)
    link = scenario.load("triangle_circle").link
    path_s = link.down_s + link.jitter_s + body.command_delay_s
    assert isinstance(follower.response, Response)
    assert follower.response.dead_time_s.value == pytest.approx(dead_s + path_s, rel=0.1)
    assert follower.response.lag_s.value == pytest.approx(lag_s, rel=0.1)
    assert follower.response.rate_lead is not None
    assert follower.response.rate_lead.value > 0.5
    assert isinstance(follower.thrust, Thrust)
    assert follower.thrust.hover_norm.value == pytest.approx(body.hover_thrust_norm, rel=0.02)
    assert isinstance(follower.drag, Drag)
    assert follower.drag.drag_1_s.value == pytest.approx(body.drag_1_s[0], rel=0.15)


def test_the_flown_mocaps_noise_and_delay_are_found(found: Identification):
    assert isinstance(found.sensing, Sensing)
    emulated = scenario.load("triangle_circle").mocap
    assert found.sensing.delay_s.value == pytest.approx(emulated.delay_s + emulated.delay_jitter_s, rel=0.1)
    for noise in found.sensing.noise:
        assert noise.pos_m is not None
        assert noise.attitude_rad is not None
        assert noise.pos_m.value == pytest.approx(emulated.noise_m, rel=0.1)
        assert noise.attitude_rad.value == pytest.approx(emulated.noise_rad, rel=0.2)


def test_the_profile_hovers_where_the_flight_did(found: Identification, tmp_path: Path):
    follower = found.drones[1]
    profile = follower.profile()
    assert isinstance(follower.thrust, Thrust)
    assert isinstance(follower.response, Response)
    assert profile.hover_thrust_norm == pytest.approx(follower.thrust.hover_norm.value, rel=1e-3)
    assert profile.response_lag_s == pytest.approx(follower.response.lag_s.value, rel=1e-3)
    path = tmp_path / "profile.toml"
    path.write_text(config_file.dump(profile), encoding="utf-8")
    assert config_file.load(path, VehicleProfile) == profile


def test_what_is_not_known_within_a_third_is_not_written(found: Identification) -> None:
    """A full thrust of -1.2 m/s^2 (-20 to 17.6), and a dead time of 46.7 ms (-104 to 197), were written as known."""
    drone = found.drones[1]
    assert isinstance(drone.response, Response)
    assert isinstance(drone.thrust, Thrust)
    vague = replace(
        drone,
        response=replace(drone.response, dead_time_s=Estimate(0.0467, -0.104, 0.197)),
        thrust=replace(drone.thrust, full_m_s2=Estimate(-1.2, -20.0, 17.6)),
    )
    assert {"response_dead_time_s", "thrust_max_n"} <= set(vague.unknown()) - set(drone.unknown())
    profile, base = vague.profile(KNOWN_WITHIN), vague.base
    assert profile.response_dead_time_s == base.response_dead_time_s
    assert (profile.thrust_max_n, profile.thrust_curve) == (base.thrust_max_n, base.thrust_curve)
    assert profile.response_lag_s == pytest.approx(drone.response.lag_s.value, rel=1e-3)


def test_a_vehicle_of_the_labs_own_is_identified_from_its_own_profile(flown: Flight):
    """As after a first `identify --write`: the mass stays, the name does not grow, no more delay inside than seen."""
    own = PROFILES["paper_40g"].model_copy(update={"name": "ours_left", "mass_kg": 0.046, "command_delay_s": 0.08})
    assert flown.run.lab is not None
    follower = flown.run.lab.followers[0].model_copy(update={"profile": "ours_left", "body": "left"})
    lab = flown.run.lab.model_copy(update={"profiles": (own,), "followers": (follower,)})
    vehicles = (flown.vehicles[0], replace(flown.vehicles[1], body="left"))
    again = identify(replace(flown, run=replace(flown.run, lab=lab), vehicles=vehicles)).drones[1]
    profile = again.profile()
    assert (profile.name, profile.mass_kg) == ("ours_left", 0.046)
    assert profile.command_delay_s <= profile.thrust_dead_time_s < 0.03


def test_the_json_holds_every_estimate(flown: Flight, found: Identification):
    values = json.loads(to_json(found))
    assert set(values["drones"]) == {v.body for v in flown.vehicles}
    for drone in values["drones"].values():
        assert drone["response_lag_s"]["low"] < drone["response_lag_s"]["value"] < drone["response_lag_s"]["high"]
        assert {"thrust_curve", "hover_thrust_norm", "pose_late_s"} <= drone.keys()


def test_a_flight_that_tells_nothing_says_so(flown: Flight):
    grounded = replace(flown, phases=flown.phases[:1])
    told = identify(grounded)
    assert all(isinstance(drone.response, str) and isinstance(drone.thrust, str) for drone in told.drones)
    assert told.drones[0].profile().response_lag_s == PROFILES["paper_40g"].response_lag_s
    assert estimate_sensing(from_records({}, [])) == "too few mocap frames"


def attitudes_seen_late(flight: Flight, by_s: float, turned: Float = frames.IDENTITY) -> Estimate | str:
    """By how much its frames' stamps are late, of the follower; its markers turned against its body."""
    poses = replace(
        flight.poses, t_s=flight.poses.t_s + by_s, q_lab_from_flu=frames.multiply(flight.poses.q_lab_from_flu, turned)
    )
    flight = replace(flight, poses=poses)
    return late(flight, flight.vehicles[1], attitudes_of(flight)[2])


@pytest.mark.parametrize("by_s", [0.006, -0.004])
def test_a_constant_error_of_the_stamps_is_found(flown: Flight, by_s: float) -> None:
    """To a millisecond, which an attitude's stamp counts; how the markers lie on the drone is no delay."""
    turned = frames.from_rotation_vector(np.array([0.06, -0.053, 0.0]))
    for found in (attitudes_seen_late(flown, by_s), attitudes_seen_late(flown, by_s, turned)):
        assert isinstance(found, Estimate)
        assert found.value == pytest.approx(by_s, abs=1e-3)
        assert 0.0 < found.half_width < 0.002
    assert late(flown, flown.vehicles[1], None) == "the autopilot reported too few attitudes"
