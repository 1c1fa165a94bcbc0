"""Where oracles and the product meet: presets and profiles told to the oracles, and the same frames for both."""

from dataclasses import dataclass

import numpy as np

from formation.config import LabConfig
from formation.control.gains import CascadeGains, Gains, GeometricGains, LagCompensation, SlidingGains
from formation.control.gains import Law as Named
from formation.control.presets import ALONE, Preset
from formation.control.stack import ControlStack, Stages
from formation.estimation.settings import Adaptation, ObserverGains, Parallel
from formation.guidance.plan import Plan
from formation.messages import LabFrame
from formation.vehicle.profile import VehicleProfile
from tests.formation.oracles.attitude import Airframe, Bounds
from tests.formation.oracles.estimator import Adaptive, Observer, Second, Traits
from tests.formation.oracles.law import Flight, Law, Quick, cascade, geometric, sliding, smc
from tests.formation.oracles.stack import Apart, OracleStack, Task, Told


def observer(gains: ObserverGains) -> Observer:
    return Observer(gains.bandwidth_rad_s, gains.alpha, gains.scale, gains.smooth)


def adaptive(gains: Adaptation) -> Adaptive:
    return Adaptive(gains.lag_s, gains.threshold, gains.most)


def second(gains: Parallel) -> Second:
    sigmas = gains.pos_sigmas, gains.vel_sigmas, gains.dist_sigmas
    return Second(gains.bandwidth_rad_s, sigmas, gains.attitude_trust, gains.urgency, gains.hold_s)


def quick(gains: LagCompensation) -> Quick:
    return Quick(gains.rate, gains.gain, gains.gain_power, gains.p1_power, gains.lead_share)


def law(gains: Gains, speed_max: float) -> Law:
    match gains:
        case CascadeGains():
            return cascade(gains.kp_position, gains.kp, gains.ki, gains.kd, speed_max)
        case GeometricGains():
            return geometric(gains.kx, gains.kv, gains.ki, gains.mix, gains.bound, speed_max)
        case SlidingGains(law=Named.SMC):
            return smc(gains.c, gains.k, speed_max)
    return sliding(gains.c, gains.p1, gains.p2, gains.eps, gains.smooth_m_s, speed_max, gains.law is Named.CFC)


def drag(body: VehicleProfile) -> np.ndarray:
    """Of a level vehicle, deceleration per m/s; sideways the mean of both body axes, whichever way it faces."""
    x, y, z = body.drag_n_s_m
    return np.array([(x + y) / 2.0, (x + y) / 2.0, z]) / body.mass_kg


def traits(gains: Preset, body: VehicleProfile, leads: bool, commanded: bool) -> Traits:
    """What the observers of a vehicle in this role are told."""
    horizontal = gains.own_observer if leads else gains.observer
    return Traits(
        commanded=commanded,
        horizontal=observer(horizontal if commanded else gains.seen_observer),
        vertical=observer(gains.vertical_observer if commanded else gains.seen_vertical_observer),
        heading=observer(gains.heading_observer if commanded else gains.seen_heading_observer),
        attitude=(gains.dead_share * body.response_dead_time_s, gains.lag_share * body.response_lag_s),
        thrust=(body.thrust_dead_time_s, body.thrust_lag_s),
        belief=(body.response_dead_time_s, body.response_lag_s),
        adaptive=adaptive(gains.seen_adaptation),
        second=second(gains.parallel if commanded else ALONE),
        second_heading=second(ALONE if commanded else gains.seen_heading_parallel),
        shift_most_s=0.6 * (body.response_dead_time_s + body.response_lag_s) if leads or gains.compensate else 0.0,
        strength_lag_s=gains.thrust_scale_lag_s,
        attitude_trust=gains.attitude_trust,
        tilt_w=gains.tilt_bandwidth_rad_s,
        tilt_decay=gains.tilt_decay_1_s,
        quiet_m=gains.quiet_m,
        quiet_rad=gains.quiet_rad,
        drag=drag(body) if commanded else np.zeros(3),
    )


def flight(gains: Preset, body: VehicleProfile, leads: bool, speed_max: float) -> Flight:
    """The law of a commanded vehicle in this role."""
    return Flight(
        horizontal=law(gains.leader if leads else gains.follower, speed_max),
        vertical=law(gains.leader_vertical if leads else gains.follower_vertical, speed_max),
        compensate=leads or gains.compensate,
        quick=quick(gains.leader_lag_compensation if leads else gains.lag_compensation),
        turn_dead_s=body.thrust_dead_time_s,
    )


def airframe(body: VehicleProfile) -> Airframe:
    return Airframe(
        body.mass_kg, body.inertia_kg_m2, body.wheelbase_m, body.thrust_curve, body.response_lag_s, body.attitude_p_1_s,
        body.yaw_p_1_s, body.rate_p_1_s, body.rate_max_rad_s, body.rate_feed_forward, drag(body),
    )  # fmt: skip


def oracle(
    config: LabConfig, bodies: tuple[VehicleProfile, ...], gains: Preset, tasks: list[Task], path=None
) -> OracleStack:
    own, limits = list(config.commanded), config.limits
    return OracleStack(
        [traits(gains, body, n == 0, n in own) for n, body in enumerate(bodies)],
        own,
        [flight(gains, bodies[n], n == 0, limits.speed_m_s) for n in own],
        [airframe(bodies[n]) for n in own],
        tasks,
        Bounds(limits.tilt_rad, np.array(limits.fence.low_m), np.array(limits.fence.high_m)),
        Apart(limits.min_separation_m, limits.speed_m_s),
        path,
    )


@dataclass(frozen=True)
class Look:
    """One frame and when the tick on it happens."""

    now_ns: int
    t_ns: int
    pos: np.ndarray
    q: np.ndarray
    seen: np.ndarray
    felt: np.ndarray | None = None


def flown(
    config: LabConfig,
    bodies: tuple[VehicleProfile, ...],
    gains: Preset,
    plan: Plan,
    looks: list[Look],
    hover: np.ndarray,
) -> list[Stages]:
    """The product on these frames."""
    stack, names = ControlStack(config, bodies, gains), tuple(v.body for v in config.vehicles)
    return [
        stack.step(k.now_ns, LabFrame(seq, k.t_ns, names, k.pos, k.q, k.seen), plan, hover, k.felt)
        for seq, k in enumerate(looks)
    ]


def foretold(stack: OracleStack, looks: list[Look], hover: np.ndarray) -> list[Told]:
    """The oracle on the same frames; copies, for it changes its estimates in place."""
    from copy import deepcopy

    return [deepcopy(stack.step(k.now_ns, k.t_ns, k.pos, k.q, k.seen, hover, k.felt)) for k in looks]
