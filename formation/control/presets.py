"""Named sets of gains: `paper`, as printed (Table 2), and `default`, ours; `pid_leader` has the paper's leader.

`no_downwash` is `default` without the feed-forward of downwash.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

from formation.config import MocapConfig
from formation.control.gains import CascadeGains, Gains, GeometricGains, LagCompensation, Law, SlidingGains
from formation.estimation.settings import Adaptation, ObserverGains, Parallel
from formation.names import unknown
from formation.vehicle.profile import GainScale, VehicleProfile

PLAIN, ALONE = LagCompensation(), Parallel()
SEEN_ADAPTATION = Adaptation(lag_s=0.117, threshold=1.55, most=6.1)


@dataclass(frozen=True, slots=True)
class Preset:
    """Everything of the controller that is not the vehicle or the lab.

    follower, follower_vertical, leader, leader_vertical: laws by role and axis; compensate: whether the followers'
    horizontal law predicts over the dead time and inverts the lag (all other loops always do); observer: FTESO of
    the followers' horizontal axes; own_observer, vertical_observer, heading_observer (rad): of a commanded leader's
    horizontal axes, of commanded heights and headings; seen_*: of a leader that is only observed (of its heading the
    fastest of several);
    dead_share, lag_share: how much of the attitude's dead time and lag is counted on;
    thrust_scale_lag_s: how slowly Z3 of the height moves into the thrust scale; downwash_share: of the modelled
    downwash of the drones above that is fed forward; the rest: see
    formation.estimation.settings and formation.control.gains.LagCompensation.
    """

    name: str
    follower: Gains
    follower_vertical: Gains
    leader: Gains
    leader_vertical: Gains
    compensate: bool
    observer: ObserverGains
    own_observer: ObserverGains
    vertical_observer: ObserverGains
    heading_observer: ObserverGains
    seen_observer: ObserverGains
    seen_vertical_observer: ObserverGains
    seen_heading_observer: ObserverGains
    dead_share: float = 1.0
    lag_share: float = 1.0
    thrust_scale_lag_s: float = 2.0
    downwash_share: float = 1.0
    attitude_trust: float = 1.0
    tilt_bandwidth_rad_s: float = 40.0
    tilt_decay_1_s: float = 7.0
    quiet_m: float = 2e-4
    seen_adaptation: Adaptation = SEEN_ADAPTATION
    parallel: Parallel = ALONE
    lag_compensation: LagCompensation = PLAIN
    leader_lag_compensation: LagCompensation = PLAIN


HORIZONTAL_LOOP_S = 0.170
"""Camera to specific force, by attitude, where the gains were found (paper_40g, 100 Hz)."""
VERTICAL_DELAY_S = 0.030
"""What the vertical loop carries at rate 1 on top of thrust's dead time and lag, which are compensated: 28 to 35 ms,
measured on the code of `formation.control.margin`; at rate s about as many times more. Behind 80 ms, 0.7 of that."""
PRINTED_ALPHA, PRINTED_EPS = -2.0 / 9.0, -0.49
PRINTED_FTESO = ObserverGains(70.0, PRINTED_ALPHA, scale=1.0, smooth=0.0)
LEADER_PID = CascadeGains(2.0, 4.0, 1.0)
HORIZONTAL = SlidingGains(Law.CFC, c=4.0, p1=4.1, p2=0.59, eps=-0.177, smooth_m_s=0.027)
VERTICAL = SlidingGains(Law.CFC, c=8.0, p1=10.0, p2=0.0, eps=-0.15, smooth_m_s=0.35)
"""Without the integral of Eq. (6): Z3 and the thrust scale do its work; wound up at take-off, it unwinds for 8 s."""
PRINTED_VERTICAL = replace(VERTICAL, p2=3.0)
SLOW_OBSERVER = ObserverGains(18.0, -0.1, 0.004)
OBSERVER = ObserverGains(12.3, -0.029, 0.004)
FAST = Parallel(
    bandwidth_rad_s=168.0,
    pos_sigmas=6.3,
    vel_sigmas=8.8,
    dist_sigmas=13.1,
    attitude_trust=0.56,
    urgency=4.4,
)
LAG_COMPENSATION = LagCompensation(rate=0.85, gain=1.5, p1_power=0.9, lead_share=0.28)
FIRM_COMPENSATION = LagCompensation(rate=1.2, gain=1.64, gain_power=0.255)
"""Of laws whose own gains nothing raises in a push."""

DEFAULT = Preset(
    name="default",
    follower=HORIZONTAL,
    follower_vertical=VERTICAL,
    leader=HORIZONTAL,
    leader_vertical=VERTICAL,
    compensate=True,
    observer=OBSERVER,
    own_observer=OBSERVER,
    vertical_observer=ObserverGains(15.0, -0.1, 0.004),
    heading_observer=ObserverGains(8.0, -0.1, 0.02),
    seen_observer=ObserverGains(12.0, -0.1, 0.004),
    seen_vertical_observer=ObserverGains(20.0, -0.1, 0.004),
    seen_heading_observer=ObserverGains(60.0, -0.1, 0.01),
    tilt_bandwidth_rad_s=18.0,
    tilt_decay_1_s=11.2,
    attitude_trust=0.13,
    parallel=FAST,
    lag_compensation=LAG_COMPENSATION,
    leader_lag_compensation=LAG_COMPENSATION,
)
NO_DOWNWASH = replace(DEFAULT, name="no_downwash", downwash_share=0.0)
PID_LEADER = replace(
    DEFAULT, name="pid_leader", leader=LEADER_PID, own_observer=SLOW_OBSERVER, leader_lag_compensation=PLAIN
)
PAPER_CFC = replace(
    PID_LEADER,
    name="paper",
    follower=SlidingGains(Law.CFC, c=1.0, p1=8.0, p2=0.1, eps=PRINTED_EPS),
    follower_vertical=PRINTED_VERTICAL,
    leader_vertical=PRINTED_VERTICAL,
    compensate=False,
    observer=PRINTED_FTESO,
    dead_share=0.9,
    lag_share=0.62,
    attitude_trust=0.65,
    parallel=ALONE,
    lag_compensation=PLAIN,
    downwash_share=0.0,
)
PAPER_ISTSMC = replace(
    PAPER_CFC,
    name="paper_istsmc",
    follower=SlidingGains(Law.ISTSMC, c=1.0, p1=8.0, p2=0.1, eps=PRINTED_EPS),
    observer=SLOW_OBSERVER,
)
PAPER_SMC = replace(PAPER_ISTSMC, name="paper_smc", follower=SlidingGains(Law.SMC, c=1.0, k=5.0))
PID = replace(PID_LEADER, name="pid", follower=CascadeGains(4.4, 13.4, 1.0), lag_compensation=FIRM_COMPENSATION)
GEOMETRIC = replace(PID, name="geometric", follower=GeometricGains(kx=50.8, kv=14.3, ki=4.0, mix=1.5, bound=1.0))
PRESETS: Mapping[str, Preset] = MappingProxyType(
    {p.name: p for p in (DEFAULT, PID_LEADER, PAPER_CFC, PAPER_ISTSMC, PAPER_SMC, PID, GEOMETRIC, NO_DOWNWASH)}
)


def preset_for(name: str, profile: VehicleProfile, mocap: MocapConfig) -> Preset:
    """The preset of that name as this vehicle and these cameras should fly it; ValueError names the known ones.

    The printed gains are what they are; all others follow the vehicle (`scaled_for`).
    """
    gains = preset(name)
    return gains if gains.name.startswith("paper") else scaled_for(gains, profile, mocap)


def loop_s(profile: VehicleProfile, mocap: MocapConfig) -> float:
    """Camera to specific force, by attitude; a dead time counts twice, because it may be twice what is believed."""
    wait_s = mocap.delay_s + 1.5 / mocap.rate_hz
    return wait_s + 2.0 * profile.response_dead_time_s + profile.response_lag_s


def gain_scale_of(profile: VehicleProfile, mocap: MocapConfig) -> GainScale:
    """How fast a vehicle's loops are flown: as it was tuned, else in inverse proportion to the loop's delay.

    Vertical: so fast that dead times
    twice as long as believed, the cameras' and the thrust's, are carried. A short loop is flown no faster than the
    gains.
    """
    if profile.gain_scale is not None:
        return profile.gain_scale
    horizontal = min(1.0, HORIZONTAL_LOOP_S / loop_s(profile, mocap))
    vertical = min(1.0, VERTICAL_DELAY_S / (mocap.delay_s + profile.thrust_dead_time_s))
    return GainScale(horizontal=horizontal, observer=horizontal, vertical=vertical)


def scaled_for(gains: Preset, profile: VehicleProfile, mocap: MocapConfig) -> Preset:
    """Gains made for the paper's vehicle at the scale of another's loops, from camera to specific force."""
    gain_scale = gain_scale_of(profile, mocap)
    return replace(
        gains,
        follower=gains.follower.scaled(gain_scale.horizontal),
        follower_vertical=gains.follower_vertical.scaled(gain_scale.vertical),
        leader=gains.leader.scaled(gain_scale.horizontal),
        leader_vertical=gains.leader_vertical.scaled(gain_scale.vertical),
        observer=gains.observer.scaled(gain_scale.observer),
        own_observer=gains.own_observer.scaled(gain_scale.observer),
        vertical_observer=gains.vertical_observer.scaled(gain_scale.vertical),
        parallel=gains.parallel.scaled(gain_scale.observer),
        dead_share=gain_scale.compensation * gains.dead_share,
        lag_share=gain_scale.compensation * gains.lag_share,
    )


def preset(name: str) -> Preset:
    """The preset of that name; ValueError names the known ones."""
    if name not in PRESETS:
        raise ValueError(f"unknown control preset {unknown(name, PRESETS)}")
    return PRESETS[name]
