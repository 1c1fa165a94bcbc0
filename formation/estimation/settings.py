"""The observers' settings for each vehicle: gains and the vehicle's model. Nothing is compiled here."""

from dataclasses import dataclass, replace

from formation.maths.arrays import Vec3


@dataclass(frozen=True, slots=True)
class Response:
    """What is counted on of a vehicle's answer to attitude and thrust commands, s."""

    attitude_dead_s: float
    attitude_lag_s: float
    thrust_dead_s: float
    thrust_lag_s: float


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
    """When observers of a vehicle that is only observed become faster: while the filtered innovation exceeds noise.

    lag_s: of that filter; threshold: in units of what noise alone leaves in it. The gain multiplies
    the bandwidth; most = 1 switches it off. One serves all axes and the tilt.
    """

    lag_s: float = 0.05
    threshold: float = 3.0
    most: float = 1.0


@dataclass(frozen=True, slots=True)
class Parallel:
    """A second, fast observer beside the first (formation.estimation.observers); bandwidth 0: there is none.

    *_sigmas: how many times what noise makes it see its position, velocity and disturbance must differ from the slow
    one's to be believed by half; attitude_trust: share of the measured tilt that a frame is given where it is believed;
    urgency: the vehicle's adaptive gain there, powers of which multiply the law's gains.
    """

    bandwidth_rad_s: float = 0.0
    pos_sigmas: float = 8.0
    vel_sigmas: float = 8.0
    dist_sigmas: float = 8.0
    attitude_trust: float = 1.0
    urgency: float = 1.0

    def scaled(self, rate: float) -> "Parallel":
        """The same observer, its bandwidth and what is above 1 of its urgency multiplied by `rate`."""
        return replace(self, bandwidth_rad_s=rate * self.bandwidth_rad_s, urgency=1.0 + rate * (self.urgency - 1.0))


@dataclass(frozen=True, slots=True)
class Airframe:
    """A vehicle as its jet and that of another know it; reach_m: of its rotors along both horizontal axes."""

    mass_kg: float
    reach_m: float
    rotor_m: float


@dataclass(frozen=True, slots=True)
class ObserverSettings:
    """One vehicle's observers, and what they believe of the vehicle.

    commanded_index: among the commanded vehicles, or -1 for one that is only observed.
    response: what is counted on of its answer to commands; nominal_*: the attitude's in full, as the profile has it, s;
    delay_shift_most_s: how far that dead time may be shifted by what is seen (0: it is as the profile has it).
    drag_1_s: of the profile, deceleration per m/s along x, y, z of `lab`, in f(x) of Eq. (4) beside gravity; 0 for a
    vehicle that is only observed.
    thrust_scale_lag_s: how slowly Z3 of the height moves into the thrust scale; attitude_trust: share of the measured
    tilt, against the modelled one, that a frame is given; tilt_bandwidth_rad_s, tilt_decay_1_s: filter of an observed
    vehicle's tilt and of its rate (0: its attitude is not used); quiet_m: position noise above which bandwidths shrink;
    parallel: of the horizontal axes; ahead_s: how far ahead its followers' commands are (formation.estimation.heading);
    downwash_share: of the modelled downwash of others that Z3 of the height follows at once.
    """

    commanded_index: int
    horizontal: ObserverGains
    vertical: ObserverGains
    heading: ObserverGains
    response: Response
    nominal_dead_s: float
    nominal_lag_s: float
    delay_shift_most_s: float
    drag_1_s: Vec3
    thrust_scale_lag_s: float
    attitude_trust: float
    tilt_bandwidth_rad_s: float
    tilt_decay_1_s: float
    quiet_m: float
    adaptation: Adaptation
    parallel: Parallel
    ahead_s: float
    airframe: Airframe
    downwash_share: float
