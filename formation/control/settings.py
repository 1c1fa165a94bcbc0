"""From a lab, its vehicles and their gains to the arrays that estimator, law and attitude read."""

import numpy as np

from formation.config import LabConfig
from formation.control.attitude import AttitudeSettings, body_row
from formation.control.composite_law import LawSettings
from formation.control.presets import Preset
from formation.estimation.state import EstimatorSettings, ObserverGains
from formation.maths.arrays import Float
from formation.vehicle.profile import VehicleProfile

FENCE_MARGIN_M = 0.05


def estimator_settings(
    config: LabConfig, profiles: tuple[VehicleProfile, ...], gains: tuple[Preset, ...]
) -> EstimatorSettings:
    """Observers and responses; profiles and gains of the n vehicles in the order of `config.vehicles`."""
    own = np.full(len(config.vehicles), -1, dtype=np.int64)
    own[list(config.commanded)] = np.arange(len(config.commanded))
    seen = own < 0
    return EstimatorSettings(
        np.array([_row(_horizontal(g, i == 0, bool(seen[i]))) for i, g in enumerate(gains)]),
        np.array([_row(g.seen_vertical_observer if seen[i] else g.vertical_observer) for i, g in enumerate(gains)]),
        np.array([_row(g.seen_heading_observer if seen[i] else g.heading_observer) for i, g in enumerate(gains)]),
        np.array([_response(p, g) for p, g in zip(profiles, gains, strict=True)]),
        own,
        np.array([_manner(g, bool(seen[i])) for i, g in enumerate(gains)]),
        np.array([(p.response_dead_time_s, p.response_lag_s) for p in profiles]),
    )


def law_settings(
    config: LabConfig, profiles: tuple[VehicleProfile, ...], gains: tuple[Preset, ...], estimator: EstimatorSettings
) -> LawSettings:
    """Laws by role."""
    mine = [(i == 0, gains[i]) for i in config.commanded]
    return LawSettings(
        np.array([(g.leader if leads else g.follower).row() for leads, g in mine]),
        np.array([(g.leader_vertical if leads else g.follower_vertical).row() for leads, g in mine]),
        estimator.response,
        np.array(config.commanded, dtype=np.int64),
        estimator.own,
        np.array([[g.compensate or leads, True] for leads, g in mine]),
        config.limits.speed_m_s,
        estimator.manner,
        np.array([_quickness(g, leads) for leads, g in mine]),
        np.array([profiles[i].thrust_dead_time_s for i in config.commanded]),
    )


def attitude_settings(config: LabConfig, profiles: tuple[VehicleProfile, ...]) -> AttitudeSettings:
    """Limits, and the bodies of the commanded vehicles."""
    limits = config.limits
    return AttitudeSettings(
        np.array(config.commanded, dtype=np.int64),
        np.array([body_row(profiles[i]) for i in config.commanded]),
        limits.tilt_rad,
        limits.min_separation_m,
        np.array(limits.fence.low_m),
        np.array(limits.fence.high_m),
        FENCE_MARGIN_M,
    )


def _horizontal(gains: Preset, leads: bool, seen: bool) -> ObserverGains:
    """The horizontal observer of a vehicle by its role."""
    if seen:
        return gains.seen_observer
    return gains.own_observer if leads else gains.observer


def _row(gains: ObserverGains) -> Float:
    return np.array([gains.bandwidth_rad_s, gains.alpha, gains.scale, gains.smooth])


def _response(profile: VehicleProfile, gains: Preset) -> Float:
    """What is counted on of a vehicle's answer to attitude and thrust."""
    return np.array(
        [gains.dead_share * profile.response_dead_time_s, gains.lag_share * profile.response_lag_s,
         profile.thrust_dead_time_s, profile.thrust_lag_s]
    )  # fmt: skip


def _manner(gains: Preset, seen: bool) -> Float:
    """The columns of EstimatorSettings.manner."""
    watch = gains.seen_vigilance if seen else gains.vigilance
    return np.array(
        [gains.strength_lag_s, gains.attitude_trust, gains.tilt_w_rad_s, gains.tilt_decay_1_s, gains.quiet_m,
         gains.quiet_rad, gains.turn_trust, watch.lag_s, watch.threshold, watch.most, watch.bandwidth_power,
         watch.habit]
    )  # fmt: skip


def _quickness(gains: Preset, leads: bool) -> Float:
    """What the law of a vehicle in this role sends ahead."""
    quick = gains.leader_quickness if leads else gains.quickness
    return np.array([quick.rate, quick.gain, quick.gain_power, quick.p1_power, quick.lead_share])
