"""From a lab, its vehicles and their gains to the records that estimator, law and attitude read."""

from math import tan

import numpy as np

from formation.config import LabConfig
from formation.control.gains import axis_gains
from formation.control.law import LawSettings
from formation.control.limits import KEEP_OUT, SEPARATION_FILTER, SPEED_LIMIT
from formation.control.limits.attitude import AttitudeSettings, ForceLimits, turn_authority
from formation.control.limits.barriers import BarrierSettings
from formation.control.presets import ALONE, Preset, loop_s
from formation.estimation.settings import Airframe, ObserverSettings, Response
from formation.maths.records import Rows, rows
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile

FENCE_MARGIN_M = 0.05
SINK_MOST_M_S = 1.0  # of what lands, or twice its rate of descent where that is more
DELAY_SHIFT_MOST = 0.6  # of the answer's length


def observer_settings(
    config: LabConfig, profiles: tuple[VehicleProfile, ...], gains: tuple[Preset, ...]
) -> Rows[ObserverSettings]:
    """Observers and responses; profiles and gains of the n vehicles in the order of `config.vehicles`."""
    commanded_index = {vehicle: i for i, vehicle in enumerate(config.commanded)}
    ahead_s = max(loop_s(profiles[i], config.mocap) for i in config.commanded)
    each = enumerate(zip(profiles, gains, strict=True))
    return rows(ObserverSettings, [_observers(i == 0, commanded_index.get(i, -1), p, g, ahead_s) for i, (p, g) in each])


def law_settings(config: LabConfig, gains: tuple[Preset, ...]) -> Rows[LawSettings]:
    """Laws by role, of the m commanded vehicles."""
    return rows(LawSettings, [_law(config, i, gains[i]) for i in config.commanded])


def attitude_settings(config: LabConfig, profiles: tuple[VehicleProfile, ...]) -> Rows[AttitudeSettings]:
    """Attitude loops of the m commanded vehicles."""
    return rows(AttitudeSettings, [_attitude(config, profiles[i]) for i in config.commanded])


def force_limits(config: LabConfig, profiles: tuple[VehicleProfile, ...]) -> Rows[ForceLimits]:
    """Limits on the force of the m commanded vehicles."""
    return rows(ForceLimits, [_force_limits(config, i, profiles[i]) for i in config.commanded])


def barrier_settings(
    config: LabConfig, profiles: tuple[VehicleProfile, ...], without: frozenset[str] = frozenset()
) -> Rows[BarrierSettings]:
    """Barriers about the n bodies; without: of formation.control.limits.MONITORS those that are switched off."""
    commanded_index = {vehicle: i for i, vehicle in enumerate(config.commanded)}
    limits = config.limits
    return rows(
        BarrierSettings,
        [
            BarrierSettings(
                commanded_index=commanded_index.get(i, -1),
                dead_s=profile.response_dead_time_s,
                separation_m=limits.min_separation_m,
                speed_m_s=limits.speed_m_s,
                sideways_m_s2=GRAVITY_M_S2 * tan(limits.tilt_rad),
                separation_on=SEPARATION_FILTER not in without,
                keep_out_on=KEEP_OUT not in without,
                speed_limit_on=SPEED_LIMIT not in without,
            )
            for i, profile in enumerate(profiles)
        ],
    )


def _observers(
    leads: bool, commanded_index: int, profile: VehicleProfile, gains: Preset, ahead_s: float
) -> ObserverSettings:
    seen = commanded_index < 0
    commanded = gains.own_observer if leads else gains.observer
    return ObserverSettings(
        commanded_index=commanded_index,
        horizontal=gains.seen_observer if seen else commanded,
        vertical=gains.seen_vertical_observer if seen else gains.vertical_observer,
        heading=gains.seen_heading_observer if seen else gains.heading_observer,
        response=_response(profile, gains),
        nominal_dead_s=profile.response_dead_time_s,
        nominal_lag_s=profile.response_lag_s,
        delay_shift_most_s=DELAY_SHIFT_MOST * (profile.response_dead_time_s + profile.response_lag_s)
        if _compensates(gains, leads)
        else 0.0,
        drag_1_s=np.zeros(3) if seen else profile.drag_1_s,
        thrust_scale_lag_s=gains.thrust_scale_lag_s,
        attitude_trust=gains.attitude_trust,
        tilt_bandwidth_rad_s=gains.tilt_bandwidth_rad_s,
        tilt_decay_1_s=gains.tilt_decay_1_s,
        quiet_m=gains.quiet_m,
        adaptation=gains.seen_adaptation,
        parallel=ALONE if seen else gains.parallel,
        ahead_s=ahead_s,
        airframe=Airframe(profile.mass_kg, profile.reach_m, profile.rotor_radius_m),
        downwash_share=gains.downwash_share,
    )


def _compensates(gains: Preset, leads: bool) -> bool:
    """Whether a vehicle's horizontal law does; a leader's always."""
    return leads or gains.compensate


def _response(profile: VehicleProfile, gains: Preset) -> Response:
    """What is counted on of a vehicle's answer to attitude and thrust."""
    return Response(
        attitude_dead_s=gains.dead_share * profile.response_dead_time_s,
        attitude_lag_s=gains.lag_share * profile.response_lag_s,
        thrust_dead_s=profile.thrust_dead_time_s,
        thrust_lag_s=profile.thrust_lag_s,
    )


def _law(config: LabConfig, i: int, gains: Preset) -> LawSettings:
    leads = i == 0
    return LawSettings(
        vehicle=i,
        horizontal=axis_gains(gains.leader if leads else gains.follower),
        vertical=axis_gains(gains.leader_vertical if leads else gains.follower_vertical),
        compensate=_compensates(gains, leads),
        lag_compensation=gains.leader_lag_compensation if leads else gains.lag_compensation,
        speed_m_s=config.limits.speed_m_s,
    )


def _attitude(config: LabConfig, profile: VehicleProfile) -> AttitudeSettings:
    yaw_lag_s = 1.0 / profile.rate_yaw_p_1_s + profile.motor_lag_s
    return AttitudeSettings(
        thrust_curve=profile.thrust_curve,
        attitude_lag_s=profile.response_lag_s,
        attitude_p_1_s=profile.attitude_p_1_s,
        yaw_p_1_s=profile.yaw_p_1_s,
        yaw_lag_s=yaw_lag_s - profile.response_dead_time_s,
        heading_lag_s=yaw_lag_s - profile.thrust_dead_time_s,
        rate_feed_forward=profile.rate_feed_forward,
        rate_max_rad_s=profile.rate_max_rad_s,
        tilt_max_rad=config.limits.tilt_rad,
    )


def _force_limits(config: LabConfig, i: int, profile: VehicleProfile) -> ForceLimits:
    limits = config.limits
    return ForceLimits(
        vehicle=i,
        drag_1_s=profile.drag_1_s,
        rate_feed_forward=profile.rate_feed_forward,
        turn_authority_rad_s2_m=turn_authority(profile),
        response_s=profile.response_dead_time_s + profile.response_lag_s,
        tilt_max_rad=limits.tilt_rad,
        fence_low_m=np.array(limits.fence.low_m),
        fence_high_m=np.array(limits.fence.high_m),
        fence_margin_m=FENCE_MARGIN_M,
        sink_most_m_s=max(SINK_MOST_M_S, 2.0 * config.flight.descend_m_s),
    )
