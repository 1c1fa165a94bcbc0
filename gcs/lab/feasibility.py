"""Whether the drones can fly as fast, turn as fast and last as long as the lab file asks. By the file alone."""

from collections.abc import Iterator
from dataclasses import dataclass
from math import tan

import numpy as np

from formation.config import LabConfig
from formation.guidance.preview import Preview
from formation.maths.arrays import Float, Vec3
from formation.trajectory_config import KINDS
from formation.vehicle.body import GRAVITY_M_S2
from gcs.finding import Finding, Keys

SPEED, REACH, TURNING, ENDURANCE, HEIGHT = "speed", "reach", "turn", "endurance", "height"
EASY_SHARE = 0.7
"""Share of a vehicle's acceleration that a trajectory may use: the rest is for corrections."""
DESCENT_MOST_M_S = 1.0
LONGEST_S, LANDING_MOST_S = 3600.0, 50.0
GROUND_EFFECT_WHEELBASES = 2.0
HOVER_MOST = 0.8
DRAG_LEAST_M_S2 = 0.005
"""Less drag is not named."""


@dataclass(frozen=True, slots=True)
class Peak:
    """The most that one vehicle is led through on the leader's trajectory.

    drag_m_s2: deceleration by the drag of its profile; lateral_m_s2, thrust_m_s2: what its thrust then has to give
    over its mass, sideways and in all.
    """

    body: str
    speed_m_s: float
    acc_m_s2: float
    drag_m_s2: float
    lateral_m_s2: float
    thrust_m_s2: float


def peaks(config: LabConfig, ahead: Preview) -> tuple[Peak, ...]:
    """The peaks of all vehicles, leader first."""
    motions = [ahead.leader[:, :, :3], *np.moveaxis(ahead.slots, 1, 0)]
    drags_1_s = [np.zeros(3) if v.sysid is None else config.profile_of(v).drag_1_s for v in config.vehicles]
    return tuple(_peak(v.body, *of) for v, *of in zip(config.vehicles, motions, drags_1_s, strict=True))


def _peak(body: str, motion: Float, drag_1_s: Vec3) -> Peak:
    vel, acc, drag = motion[:, 1], motion[:, 2], drag_1_s * motion[:, 1]
    force = acc + drag + np.array([0.0, 0.0, GRAVITY_M_S2])
    return Peak(body, _longest(vel), _longest(acc), _longest(drag), _longest(force[:, :2]), _longest(force))


def _longest(vectors: Float) -> float:
    return float(np.linalg.norm(vectors, axis=-1).max())


def judge_feasibility(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    """Judge speeds, accelerations, turns, heights and durations."""
    yield from _closing_speeds(config, keys)
    yield from _heights(config, keys)
    yield from _vehicles(config, keys)
    if config.leader.sysid is not None:
        yield from judge_trajectory(config, keys, ahead)


def judge_trajectory(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    """Judge the leader's trajectory: speed, tilt, thrust, turn and how long it lasts, the slots' too."""
    yield from _speed_and_tilt(config, keys, ahead)
    yield from _turns(config, keys, ahead)
    yield from _duration(config, keys, ahead)


def trajectory_text(config: LabConfig, ahead: Preview) -> str:
    """The leader's trajectory in words: kind, length, duration, and the most that anybody is led through."""
    every = peaks(config, ahead)
    fastest, hardest = max(p.speed_m_s for p in every), max(p.acc_m_s2 for p in every)
    text = f"{config.leader.trajectory.kind}, {ahead.length_m:.2f} m in {ahead.duration_s:.1f} s"
    return f"{text}, up to {fastest:.2f} m/s and {hardest:.2f} m/s^2"


def _speed_and_tilt(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    """The trajectory's speed and acceleration, the leader's own first; one finding each."""
    most_m_s, tilt_rad, every = config.limits.speed_m_s, config.limits.tilt_rad, peaks(config, ahead)
    fastest = every[0] if every[0].speed_m_s > most_m_s else max(every, key=lambda peak: peak.speed_m_s)
    if fastest.speed_m_s > most_m_s + 1e-9:
        why = f"{fastest.body} would fly at {fastest.speed_m_s:.2f} m/s, limits.speed_m_s is {most_m_s:g}"
        yield keys.reject(_speed_key(config, every[0].speed_m_s <= most_m_s), SPEED, why)
    reach = [_reach(config, i, tilt_rad, peak) for i, peak in enumerate(every)]
    i = 0 if reach[0] > 1.0 else int(np.argmax(reach))
    if reach[i] > EASY_SHARE:
        key = _speed_key(config, reach[0] <= EASY_SHARE)
        profile = config.vehicles[i].profile
        drag_m_s2 = every[i].drag_m_s2
        against = f" against {drag_m_s2:.2f} m/s^2 of drag" if drag_m_s2 >= DRAG_LEAST_M_S2 else ""
        why = (
            f"{every[i].body} would accelerate by {every[i].acc_m_s2:.2f} m/s^2{against}, {reach[i]:.0%} of what "
            f"{profile} reaches under limits.tilt_rad = {tilt_rad:g}"
        )
        yield keys.reject(key, REACH, why) if reach[i] > 1.0 else keys.warn(key, REACH, why)


def _reach(config: LabConfig, i: int, tilt_rad: float, peak: Peak) -> float:
    """The share of vehicle i's tilt and thrust that its path takes, 1: all."""
    profile = config.profile_of(config.vehicles[i])
    spare_m_s2 = max(profile.thrust_max_n / profile.mass_kg - GRAVITY_M_S2, 1e-9)
    lateral = peak.lateral_m_s2 / (GRAVITY_M_S2 * tan(tilt_rad))
    return max(lateral, (peak.thrust_m_s2 - GRAVITY_M_S2) / spare_m_s2)


def _speed_key(config: LabConfig, leader_is_slow: bool) -> str:
    path = config.leader.trajectory
    name = "yaw_rate_rad_s" if leader_is_slow and path.yaw_rate_rad_s else KINDS[path.kind].speed_key
    return f"leader.trajectory.{name}"


def _turns(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    path, rate_rad_s = config.leader.trajectory, float(np.abs(ahead.leader[:, 1, 3]).max())
    for vehicle in config.vehicles:
        most_rad_s = config.profile_of(vehicle).rate_yaw_max_rad_s
        if rate_rad_s > most_rad_s:
            why = f"{vehicle.body} would turn at {rate_rad_s:.1f} rad/s, {vehicle.profile} does {most_rad_s:g}"
            name = "yaw_rate_rad_s" if path.yaw_rate_rad_s else KINDS[path.kind].speed_key
            yield keys.reject(
                f"leader.trajectory.{name}", TURNING, f"{why} (radians are meant; a column may say [deg])"
            )
            return


def _duration(config: LabConfig, keys: Keys, ahead: Preview) -> Iterator[Finding]:
    path, took_s = config.leader.trajectory, ahead.duration_s
    named = KINDS[path.kind].speed_key if "duration_s" not in KINDS[path.kind].used else "duration_s"
    key = f"leader.trajectory.{'laps' if path.laps is not None else named}"
    if took_s > LONGEST_S:
        yield keys.reject(key, ENDURANCE, f"the trajectory would last {took_s:.0f} s, no drone flies for an hour")
        return
    batteries = {v.body: config.profile_of(v).battery for v in config.vehicles}
    lasting_s = {body: 3.6 * battery.capacity_mah / battery.hover_current_a for body, battery in batteries.items()}
    body = min(lasting_s, key=lambda name: lasting_s[name])
    if took_s > EASY_SHARE * lasting_s[body]:
        why = f"the trajectory lasts {took_s:.0f} s, the battery of {body} hovers for about {lasting_s[body]:.0f} s"
        yield keys.warn(key, ENDURANCE, why)


def _closing_speeds(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    flight, most_m_s = config.flight, config.limits.speed_m_s
    speeds = {
        "climb_m_s": flight.climb_m_s,
        "descend_m_s": flight.descend_m_s,
        "formation_change_m_s": flight.formation_change_m_s,
    }
    for name, speed_m_s in speeds.items():
        if speed_m_s > most_m_s:
            yield keys.reject(f"flight.{name}", SPEED, f"limits.speed_m_s is {most_m_s:g}")
    if DESCENT_MOST_M_S < flight.descend_m_s <= most_m_s:
        why = "faster than drones land softly, and sink through their own downwash"
        yield keys.warn("flight.descend_m_s", SPEED, why, f"{DESCENT_MOST_M_S:g} m/s at most")


def _heights(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    flight = config.flight
    wheelbase_m, name = max((config.profile_of(v).wheelbase_m, v.profile) for v in config.vehicles)
    if flight.altitude_m < GROUND_EFFECT_WHEELBASES * wheelbase_m:
        why = f"in ground effect: under {GROUND_EFFECT_WHEELBASES:g} wheelbases of {name}"
        yield keys.warn("flight.altitude_m", HEIGHT, why, f"{GROUND_EFFECT_WHEELBASES * wheelbase_m:.2g} m or more")
    if flight.altitude_m / flight.descend_m_s > LANDING_MOST_S:
        why = f"a landing from flight.altitude_m = {flight.altitude_m:g} m would take longer than a minute"
        yield keys.warn("flight.descend_m_s", ENDURANCE, why)


def _vehicles(config: LabConfig, keys: Keys) -> Iterator[Finding]:
    """Reject what is no quadcopter: a profile of the lab's own that could not hover, or hardly."""
    for k, own in enumerate(config.profiles):
        hover = own.weight_n / own.thrust_max_n
        why = f"all of its thrust is {1.0 / hover:.2f} times its weight: SI is meant, kilograms and newtons"
        if hover * 1e-3 * hover > 0.5**2:  # nearer to a hover at half its thrust where the mass is in grams
            yield keys.reject(f"profiles[{k}].mass_kg", REACH, f"{why}; grams?")
        elif hover >= 1.0:
            yield keys.reject(f"profiles[{k}].thrust_max_n", REACH, why)
        elif own.hover_thrust_norm > HOVER_MOST:
            yield keys.warn(f"profiles[{k}].thrust_max_n", REACH, why)
