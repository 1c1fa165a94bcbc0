"""What the observers are told of each vehicle: gains, and what is believed of it. Nothing is compiled here."""

from dataclasses import dataclass, replace

from formation.vehicle.response import Response


@dataclass(frozen=True, slots=True)
class ObserverGains:
    """w and a of Eqs. (3)-(4), and the error scale e0 that gives the fractional powers a natural length.

    Corrections are e0 sig(e / e0)^(1 + i a): at |e| = e0 the bandwidth is w. The paper's own is e0 = 1 m.
    smooth rounds the powers off below |e| = smooth e0, so that noise alone never sees more than about w.
    """

    bandwidth_rad_s: float
    alpha: float
    scale: float
    smooth: float = 1.0

    def scaled(self, rate: float) -> "ObserverGains":
        """The same observer, its bandwidth multiplied by `rate`."""
        return replace(self, bandwidth_rad_s=rate * self.bandwidth_rad_s)


@dataclass(frozen=True, slots=True)
class Adaptation:
    """When observers become faster: while the innovation, filtered over lag_s, exceeds what is expected.

    What is expected: noise, what the measurement's own noise leaves in the filter, times threshold; and mean_share of
    the innovation's mean square over some seconds, so that a lasting oscillation calms the loop instead of exciting it.
    gain^bandwidth_power multiplies the bandwidth (and powers of it the law's gains); most = 1 switches it off. One
    gain serves both horizontal axes; of a vehicle that is only observed it serves all axes and the tilt, and its
    heading has one of its own.
    """

    lag_s: float = 0.05
    threshold: float = 3.0
    most: float = 1.0
    bandwidth_power: float = 1.0
    mean_share: float = 0.15


@dataclass(frozen=True, slots=True)
class ObserverSettings:
    """One vehicle's observers, and what they believe of the vehicle.

    place: among the commanded vehicles, or -1 for one that is only observed.
    response: what is counted on of its answer to commands; nominal_*: the attitude's in full, as the profile has it, s.
    thrust_scale_lag_s: how slowly Z3 of the height moves into the thrust scale; attitude_trust: share of the measured
    tilt, against the modelled one, that a frame is given; tilt_bandwidth_rad_s, tilt_decay_1_s: filter of an observed
    vehicle's tilt and of its rate (0: its attitude is not used); quiet_m, quiet_rad: position noise above which
    bandwidths shrink, and heading noise that is always expected; yaw_trust: how much of an observed heading's Z3 is
    taken to last.
    """

    place: int
    horizontal: ObserverGains
    vertical: ObserverGains
    heading: ObserverGains
    response: Response
    nominal_dead_s: float
    nominal_lag_s: float
    thrust_scale_lag_s: float
    attitude_trust: float
    tilt_bandwidth_rad_s: float
    tilt_decay_1_s: float
    quiet_m: float
    quiet_rad: float
    yaw_trust: float
    adaptation: Adaptation
