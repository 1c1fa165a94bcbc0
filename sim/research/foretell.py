"""`gcs-sim foretell`: a flight that others flew, foretold, and how far the simulator is to be trusted about it.

The recorded reference is flown by the vehicles of the host of studies: under a law of others, which flies on board and
knows its place as late and as noisily as that autopilot did, or by a preset of ours, for a follower beside a leader of
the same vehicle. Flown and foretold are judged over the same seconds of the same reference.
"""

import json
from collections import deque
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

import numpy as np
from rich.table import Table
from scipy.ndimage import gaussian_filter1d

from analysis.identify import sensing
from analysis.identify.signals import Estimate
from analysis.load import Flight
from analysis.metrics import summarise
from formation.codes import FlightResult
from formation.config import Fence, FlightConfig, FollowerConfig, LabConfig, LeaderConfig, LimitsConfig
from formation.maths import frames
from formation.maths.arrays import Float
from formation.messages import AttitudeTarget
from formation.own_law.law import ControlLaw, PointMotion, Situation
from formation.trajectory_config import TrajectoryConfig
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from sim.research.host import Vehicles, fly
from sim.research.laws import ChosenLaw
from sim.research.recorded import RecordedError
from sim.research.whatif import spectrum
from sim.scenario import LinkModel, Pose, Scenario, TrueVehicle
from sim.world import T0_NS

SYSID, BESIDE_M, MARGIN_M = 2, (0.0, -2.0, 0.0), 5.0
TICK_S = 0.01
"""Position control of a Crazyflie, and about that of PX4."""
HOVERED_S = 5.0
"""Before the reference begins, at its first point, so that the integrals hold the weight."""
SETTLED_S = 3.0
"""Of the reference, before anything is judged."""
STEP_M_S, OVER = 4.0, 10
"""A reference that is faster, over so many ticks, steps: it is flown up to there, or from there on."""
CLEAR_M, LEAST_S, DELAY_MOST_S = 0.3, 5.0, 1.5
"""It flies higher than that above the floor; so long is judged at least; no reference is followed later."""
BANDS_HZ = (0.0, 0.2, 0.5, 1.0, 2.0, 5.0)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """What is flown, every TICK_S: t_s (T,), of the log; reference, its velocity, position flown (T, 3); heading (T,).

    late_s, noise_m: how much later than the cameras the autopilot knew its place, and their noise.
    """

    body: str
    t_s: Float
    pos_lab_m: Float
    vel_lab_m_s: Float
    heading_rad: Float
    flown_lab_m: Float
    late_s: float
    noise_m: float


@dataclass(frozen=True, slots=True)
class Errors:
    """Distances from the reference, m, and its delay, s; band_rms_m: the error's RMS in each of BANDS_HZ."""

    rms_m: float
    p95_m: float
    max_m: float
    delay_s: float
    band_rms_m: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Foretold:
    """One flight, flown and foretold. path_rms_m: of the foretold path from the flown one; speed_m_s: 95 % of the
    reference's are below it. builtin: how a preset of ours ends, in the place of `foretold`, and its RMS from its
    slot.
    """

    body: str
    law: str
    vehicle: str
    speed_m_s: float
    seconds: float
    late_s: float
    noise_m: float
    flown: Errors
    foretold: Errors | None = None
    path_rms_m: float | None = None
    builtin: FlightResult | None = None
    builtin_rms_m: float | None = None

    @property
    def off_share(self) -> float | None:
        """How much more error was foretold than flown, as a share."""
        return None if self.foretold is None else self.foretold.rms_m / self.flown.rms_m - 1.0

    @property
    def text(self) -> str:
        """Within what the simulator is to be trusted, in one line."""
        if self.foretold is None or self.off_share is None or self.path_rms_m is None:
            if self.builtin_rms_m is None:
                return f"{self.law} does not fly {self.vehicle} along this reference to its end: {self.builtin}"
            return f"{self.law} would hold its slot within {1e3 * self.builtin_rms_m:.1f} mm RMS, simulated"
        return (
            f"trust the simulator within {abs(self.off_share):.0%} of the error and {1e3 * self.path_rms_m:.0f} mm of "
            f"the path (RMS) for {self.vehicle} under {self.law} up to {self.speed_m_s:.1f} m/s"
        )

    def to_json(self) -> str:
        """All numbers, SI."""
        return json.dumps(asdict(self) | {"off_share": self.off_share, "text": self.text}, indent=2, allow_nan=False)


def table(found: Foretold) -> Table:
    """Flown and foretold, side by side, for a terminal."""
    title = (
        f"{found.body}: {found.seconds:.0f} s at {found.speed_m_s:.1f} m/s\n"
        f"position known {1e3 * found.late_s:.0f} ms late, noise {1e3 * found.noise_m:.2f} mm"
    )
    shown = Table(title=title, title_justify="left", box=None)
    for column in ("", "flown", f"{found.law}, foretold"):
        shown.add_column(column, justify="right" if column else "left")
    sides = [side for side in (found.flown, found.foretold) if side is not None]
    for name, key, unit in (
        ("error, RMS", "rms_m", "mm"), ("error, 95 %", "p95_m", "mm"), ("error, largest", "max_m", "mm"),
        ("behind the reference", "delay_s", "ms"),
    ):  # fmt: skip
        shown.add_row(name, *(f"{1e3 * getattr(side, key):.0f} {unit}" for side in sides))
    for k, (low, high) in enumerate(pairwise(BANDS_HZ)):
        shown.add_row(f"error, {low:g} to {high:g} Hz", *(f"{1e3 * side.band_rms_m[k]:.1f} mm" for side in sides))
    if found.builtin_rms_m is not None:
        shown.add_row("from its slot, RMS", "–", f"{1e3 * found.builtin_rms_m:.1f} mm")
    return shown


def course_of(flight: Flight) -> Course:
    """The longest stretch in the air on which the reference does not step; RecordedError where there is none."""
    vehicle = next((v for v in flight.vehicles if (v.body, "reference_position") in flight.signals), None)
    if vehicle is None or not len(flight.poses):
        raise RecordedError("the log holds no reference position beside poses: import one that does")
    of = {name: signal for (body, name), signal in flight.signals.items() if body == vehicle.body}
    index, poses = flight.vehicles.index(vehicle), flight.poses
    seen = poses.seen[:, index]
    short = f"{vehicle.body} follows no reference in the air for {SETTLED_S + LEAST_S:g} s"
    if not seen.any() or np.ptp(poses.t_s[seen]) < SETTLED_S + LEAST_S:
        raise RecordedError(short)
    log_late = sensing.late(flight, vehicle, sensing.logged_attitudes(flight, vehicle))
    log_late_s = -log_late.value if isinstance(log_late, Estimate) else 0.0
    t_s = np.arange(poses.t_s[seen][0], poses.t_s[seen][-1], TICK_S)
    reference = of["reference_position"].at(t_s + log_late_s)
    flown = np.stack([np.interp(t_s, poses.t_s[seen], axis) for axis in poses.pos_lab_m[seen, index].T], axis=1)
    floor_m = float(flown[:, 2].min())
    flies = (flown[:, 2] > floor_m + CLEAR_M) & (reference[:, 2] > floor_m + CLEAR_M)  # NaN is not
    flies &= ~(_speed_m_s(reference) > STEP_M_S)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flies, [False]])))
    begin, end = max(edges.reshape(-1, 2).tolist(), key=lambda edge: edge[1] - edge[0], default=(0, 0))
    if (end - begin) * TICK_S < SETTLED_S + LEAST_S:
        raise RecordedError(short)
    part = slice(begin, end)
    speed, heading = of.get("reference_velocity"), of.get("reference_heading")
    behind, noise = sensing.behind(flight, vehicle), sensing.scatter(poses.t_s[seen], poses.pos_lab_m[seen, index])
    return Course(
        body=vehicle.body,
        t_s=t_s[part],
        pos_lab_m=reference[part],
        vel_lab_m_s=np.zeros_like(reference[part])  # a reference that has none asks for none
        if speed is None else np.nan_to_num(speed.at(t_s[part] + log_late_s)),
        heading_rad=np.zeros(end - begin)
        if heading is None else np.nan_to_num(heading.at(t_s[part] + log_late_s)[:, 0]),
        flown_lab_m=flown[part],
        late_s=max(behind.value - log_late_s, 0.0) if isinstance(behind, Estimate) else 0.0,
        noise_m=0.0 if noise is None else noise.value,
    )  # fmt: skip


def _speed_m_s(pos_lab_m: Float) -> Float:
    """(T,): mean over the OVER ticks after each."""
    after = np.concatenate([pos_lab_m[OVER:], np.repeat(pos_lab_m[-1:], OVER, axis=0)])
    speed: Float = np.linalg.norm(after - pos_lab_m, axis=1) / (OVER * TICK_S)
    return speed


def foretell(flight: Flight, profile: VehicleProfile, law: ChosenLaw, seed: int = 1) -> Foretold:
    """Fly the recorded reference with that vehicle and law; RecordedError, ValueError for a law that cannot be made."""
    course = course_of(flight)
    judged = course.t_s > course.t_s[0] + SETTLED_S
    speeds_m_s = _speed_m_s(course.pos_lab_m)[judged]
    result = Foretold(
        body=course.body, law=law.label, vehicle=profile.name, speed_m_s=float(np.percentile(speeds_m_s, 95.0)),
        seconds=float(judged.sum() * TICK_S), late_s=course.late_s, noise_m=course.noise_m,
        flown=errors(course, course.flown_lab_m, judged),
    )  # fmt: skip
    if law.is_preset:
        outcome, flown = fly(scenario_along(profile, course, law), seed)
        rms_m = summarise(flown).formation_rms_m if outcome is FlightResult.HELD else None
        return replace(result, builtin=outcome, builtin_rms_m=rms_m)
    path = fly_on_board(course, profile, law.maker()(), seed).pos_lab_m
    between_m = np.linalg.norm(path - course.flown_lab_m, axis=1)[judged]
    path_rms_m = float(np.sqrt(np.mean(between_m**2)))
    return replace(result, foretold=errors(course, path, judged), path_rms_m=path_rms_m)


def errors(course: Course, path_lab_m: Float, judged: Float) -> Errors:
    """Of a path (T, 3) from the reference, where it is judged (T,)."""
    error_m = (path_lab_m - course.pos_lab_m)[judged]
    distance_m = np.linalg.norm(error_m, axis=1)
    delays_s = np.arange(0.0, DELAY_MOST_S, TICK_S)
    squares = [np.mean(np.square(path_lab_m[judged] - _delayed(course, judged, delay_s))) for delay_s in delays_s]
    hz, power = spectrum(course.t_s[judged], error_m)
    mean_square = np.mean(np.square(error_m).sum(axis=1)) / power.sum() if power.sum() > 0.0 else 0.0
    return Errors(
        rms_m=float(np.sqrt(np.mean(distance_m**2))),
        p95_m=float(np.percentile(distance_m, 95.0)),
        max_m=float(distance_m.max()),
        delay_s=float(delays_s[int(np.argmin(squares))]),
        band_rms_m=tuple(
            float(np.sqrt(mean_square * power[(low <= hz) & (hz < high)].sum())) for low, high in pairwise(BANDS_HZ)
        ),
    )


def _delayed(course: Course, judged: Float, delay_s: float) -> Float:
    at_s = course.t_s[judged] - delay_s
    return np.stack([np.interp(at_s, course.t_s, axis) for axis in course.pos_lab_m.T], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class OnBoard:
    """At the course's times: position (T, 3) and attitude (T, 4) flown, attitude (T, 4) and thrust (T,) commanded."""

    pos_lab_m: Float
    q_lab_from_flu: Float
    commanded_q_lab_from_flu: Float
    thrust_norm: Float


def fly_on_board(course: Course, profile: VehicleProfile, law: ControlLaw, seed: int) -> OnBoard:
    """What the vehicle does under a law that flies on board.

    The law's thrust goes out by the law's own `full_thrust_m_s2`, where it has one, else as the profile says.
    """
    vehicles = Vehicles(scenario_along(profile, course, None), None, seed)
    rng = np.random.default_rng([seed, 5])
    full_m_s2 = getattr(law, "full_thrust_m_s2", None)
    vehicles.flown["x"][0, 0:3] = course.pos_lab_m[0]
    vehicles.flown["x"][0, 6:10] = frames.from_yaw(course.heading_rad[:1])[0]
    vehicles.flown["x"][0, 13:17] = 0.25 * profile.weight_n
    hovered, late = round(HOVERED_S / TICK_S), round(course.late_s / TICK_S)
    shown_m = deque([course.pos_lab_m[0]] * (late + 1), maxlen=late + 1)
    count, still, none = len(course.t_s), np.zeros(3), np.zeros((1, 3))
    flown = OnBoard(*(np.empty((count, *width)) for width in ((3,), (4,), (4,), ())))
    for tick in range(-hovered, count):
        k, now_ns = max(tick, 0), T0_NS + round((tick + hovered) * TICK_S * 1e9)
        x = vehicles.states_at(now_ns)[vehicles.bodies[0], 1:]
        flown.pos_lab_m[k], flown.q_lab_from_flu[k] = x[0:3], x[6:10]
        shown_m.append(x[0:3] + course.noise_m * rng.standard_normal(3))
        heading_rad = float(course.heading_rad[k])
        slot = PointMotion(course.pos_lab_m[k], course.vel_lab_m_s[k] if tick >= 0 else still, still)
        at = Situation(
            body=course.body, dt_s=TICK_S if tick > -hovered else 0.0, own=PointMotion(shown_m[0], x[3:6], still),
            slot=slot, leader=slot, heading_rad=heading_rad, heading_rate_rad_s=0.0, error_lead_m=still,
            error_rate_lead_m_s=still, disturbance_lab_m_s2=still,
            lag_s=(profile.response_lag_s, profile.thrust_lag_s), saturated=False,
        )  # fmt: skip
        force_m_s2 = np.asarray(law(at), np.float64) + np.array([0.0, 0.0, GRAVITY_M_S2])
        asked_m_s2 = float(np.linalg.norm(force_m_s2))
        thrust_norm = (
            profile.thrust_norm_of(profile.mass_kg * asked_m_s2) if full_m_s2 is None else asked_m_s2 / full_m_s2
        )
        q = frames.multiply(_tilted(force_m_s2 / max(asked_m_s2, 1e-9)), frames.from_yaw(np.array(heading_rad)))
        thrust = np.array([min(thrust_norm, 1.0)])
        flown.commanded_q_lab_from_flu[k], flown.thrust_norm[k] = q, thrust[0]
        vehicles.order(AttitudeTarget(now_ns, q[None], none, thrust, np.zeros(1), np.zeros(1, np.bool_)), now_ns)
        vehicles.drain(TICK_S)
    return flown


def _tilted(up: Float) -> Float:
    """The shortest turn of the vertical onto `up` (3)."""
    axis = np.array([-up[1], up[0], 0.0])
    sine = float(np.linalg.norm(axis))
    return frames.from_rotation_vector(axis * (np.arctan2(sine, up[2]) / sine if sine > 0.0 else 1.0))


def scenario_along(profile: VehicleProfile, course: Course, law: ChosenLaw | None) -> Scenario:
    """A follower of that vehicle beside a leader: of a preset, which flies the course, else one that stands there."""
    points: tuple[tuple[float, float, float, float, float], ...] = ()
    x, y, z = course.pos_lab_m[0].tolist()
    if law is not None:
        # Begun from rest, it shows half of SETTLED_S in SETTLED_S. Smoothed: stamps of a recorder jitter.
        since_s = course.t_s - course.t_s[0]
        eased_s = np.sqrt(2.0 * SETTLED_S * since_s)
        since_s = np.where(eased_s < SETTLED_S, eased_s, since_s + 0.5 * SETTLED_S)
        smooth_m = gaussian_filter1d(course.pos_lab_m, OVER, axis=0)
        points = tuple((t, *at, 0.0) for t, at in zip(since_s.tolist(), smooth_m.tolist(), strict=True))
    low, high = course.pos_lab_m.min(axis=0) - MARGIN_M, course.pos_lab_m.max(axis=0) + MARGIN_M
    limits = LimitsConfig(fence=Fence(low_m=(float(low[0]), float(low[1]), -0.1), high_m=tuple(high.tolist())))
    trajectory = TrajectoryConfig(kind="file", points=points) if points else TrajectoryConfig()
    lab = LabConfig(
        profiles=(profile,),
        leader=LeaderConfig(body="leader", sysid=1 if points else None, profile=profile.name, trajectory=trajectory),
        followers=(FollowerConfig(body="follower", sysid=SYSID, profile=profile.name, offset_m=BESIDE_M),),
        flight=FlightConfig(altitude_m=max(z, CLEAR_M)), limits=limits,
    )  # fmt: skip
    if law is None:
        return Scenario(name="foretell", lab=lab, link=LinkModel(down_s=0.0, up_s=0.0, jitter_s=0.0))
    leader = TrueVehicle(sysid=1, start=Pose(pos_lab_m=(x, y, 0.0)))
    return Scenario(
        name="foretell", lab=law.lab(lab), vehicles=(leader,), longest_s=course.t_s[-1] - course.t_s[0] + 60.0
    )
