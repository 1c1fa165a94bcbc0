"""The spine: one frozen message per stage, from motion capture to attitude targets.

    camera bytes -> RawFrame -> LabFrame -> SwarmState -> Reference -> Command -> AttitudeTarget -> bytes
    drone bytes  -> Telemetry -> LinkState -> safety   -> Phase

Two indexings, both fixed for a run by the configuration, leader first where present:
`n` counts all vehicles (leader and followers), `m` the commanded ones (those with a sysid).
What crosses one drone's MAVLink is in `wire.link_messages`.
The log and the bus hold the arrays of control's stages in single precision: a replay makes them anew, and MAVLink
carries the targets so. The same for the simulator's truth and innovations. All else is exact.
"""

from dataclasses import dataclass, field, replace
from enum import IntEnum, IntFlag

import numpy as np

from formation.clock_pair import ClockPair as ClockPair
from formation.codes import Cause as Cause
from formation.codes import EventCode as EventCode
from formation.codes import Phase as Phase
from formation.codes import Severity as Severity
from formation.codes import condition_key
from formation.maths.arrays import (
    Codes,
    Flags,
    Quats,
    Scalars,
    SingleQuat,
    SingleQuats,
    SingleScalars,
    SingleVec3,
    SingleVec3s,
    Vec3s,
)
from formation.requests import OperatorReply as OperatorReply
from formation.requests import OperatorRequest as OperatorRequest
from formation.requests import Verb as Verb


@dataclass(frozen=True, slots=True, eq=False)
class RawFrame:
    """One exposure as the motion capture reports it: its own axes, names and marker frames, nothing checked yet.

    t_capture_ns: exposure, on this machine's monotonic clock; 0 where the source has no stamp.
    """

    seq: int
    t_capture_ns: int
    bodies: tuple[str, ...]
    pos_mocap_m: Vec3s
    q_mocap_from_marker: Quats
    seen: Flags


@dataclass(frozen=True, slots=True, eq=False)
class LabFrame:
    """One exposure of the lab's n vehicles in the configuration's order, checked, in `lab` and `flu`.

    Made by the mocap process alone (mocap.alignment). t_capture_ns: exposure; t_receive_ns: when the mocap process
    had the raw frame, 0 where there was none; both monotonic. An unseen body keeps any finite pose.
    rejected: the formation.messages.Rejection of each body whose pose was not believed, which is then unseen.
    """

    seq: int
    t_capture_ns: int
    bodies: tuple[str, ...]
    pos_lab_m: Vec3s
    q_lab_from_flu: Quats
    seen: Flags
    t_receive_ns: int = 0
    rejected: Codes = field(default_factory=lambda: np.zeros(0, np.uint8))

    def __post_init__(self) -> None:
        if len(self.rejected) == 0:  # nobody was judged, or by a version that said nothing of it
            object.__setattr__(self, "rejected", np.zeros(len(self.bodies), np.uint8))


@dataclass(frozen=True, slots=True)
class Datagram:
    """MAVLink bytes to or from the drone `sysid`; one datagram may hold several packets.

    superseded: packets of its telemetry that arrived before it and were dropped unread, since newer ones had arrived.
    """

    sysid: int
    data: bytes
    superseded: int = 0


@dataclass(frozen=True, slots=True)
class PhaseChange:
    """The swarm entered `phase`; recorded once at start (GROUND) and at every change, with the cause in words.

    The log's timeline is read from these records alone; `Event` texts are for people.
    """

    phase: Phase
    cause: str = ""
    code: Cause = Cause.UNKNOWN


@dataclass(frozen=True, slots=True, eq=False)
class SwarmState:
    """What the observers know of all n vehicles at the capture time `t_ns`.

    Z1, Z2, Z3 of the FTESO (Eqs. 3-4) are pos, vel and dist; the drag of a commanded vehicle's profile is no part of
    dist. `acc` is modelled acceleration plus Z3.
    `age_s` is the time since each body was last seen, infinite before the first time; yaw is unwrapped.
    `model_mismatch`: how far each vehicle answers otherwise than its profile says, as a share of its response's length
    (formation.estimation.response).
    """

    t_ns: int
    pos_lab_m: SingleVec3s
    vel_lab_m_s: SingleVec3s
    dist_lab_m_s2: SingleVec3s
    acc_lab_m_s2: SingleVec3s
    q_lab_from_flu: SingleQuats
    yaw_rad: SingleScalars
    yaw_rate_rad_s: SingleScalars
    yaw_acc_rad_s2: SingleScalars
    age_s: SingleScalars
    model_mismatch: SingleScalars


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Where each of the m commanded vehicles should be, relative to its own `lead` frame.

    The frame (origin_*, heading_*) is the leader's, or the lab itself: a leader at rest at zero.
    slot_* is lambda_d and its derivatives in that frame (Eq. 2); yaw is lambda_psi.
    `in_formation` marks vehicles whose frame is the leader's.
    """

    t_ns: int
    origin_lab_m: SingleVec3s
    origin_vel_lab_m_s: SingleVec3s
    origin_acc_lab_m_s2: SingleVec3s
    heading_rad: SingleScalars
    heading_rate_rad_s: SingleScalars
    heading_acc_rad_s2: SingleScalars
    slot_lead_m: SingleVec3s
    slot_vel_lead_m_s: SingleVec3s
    slot_acc_lead_m_s2: SingleVec3s
    slot_yaw_rad: SingleScalars
    slot_yaw_rate_rad_s: SingleScalars
    in_formation: Flags


@dataclass(frozen=True, slots=True, eq=False)
class Command:
    """The sliding-mode law's inside and its demand, for the m commanded vehicles (Eqs. 5-7).

    e, e_rate, s, t_m, z_m in the `lead` frame; acc_lab_m_s2 is the demanded acceleration, gravity excluded.
    """

    t_ns: int
    e_lead_m: SingleVec3s
    e_rate_lead_m_s: SingleVec3s
    s_lead_m_s: SingleVec3s
    t_m_lead_m_s2: SingleVec3s
    z_m_lead_m_s2: SingleVec3s
    dist_lab_m_s2: SingleVec3s
    acc_lab_m_s2: SingleVec3s
    yaw_rad: SingleScalars
    yaw_rate_rad_s: SingleScalars


class Saturation(IntFlag):
    """Which limits a vehicle's target met this tick."""

    NONE = 0
    TILT = 1
    THRUST_LOW = 2
    THRUST_HIGH = 4
    SPEED = 8
    FENCE = 16
    SEPARATION = 32


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeTarget:
    """Attitude, body rate and thrust for the m commanded vehicles, bit by bit what SET_ATTITUDE_TARGET carries.

    thrust_norm: fraction of full collective thrust, 0..1; saturation: `Saturation` bits; held_off: whose setpoint is
    not sent, since its pose is rejected.
    """

    t_ns: int
    q_lab_from_flu: SingleQuats
    rate_flu_rad_s: SingleVec3s
    thrust_norm: SingleScalars
    saturation: SingleScalars
    held_off: Flags


@dataclass(frozen=True, slots=True)
class Event:
    """An event for the operator: a phase change, a rejection, a fault, a recovery.

    code: what it is, for programs: an EventCode, a rule's or a Rejection's name; empty for what others say. subject:
    the body that it is about, if it is about one. lasts: the condition lasts until an event of the same `key` ends it.
    """

    severity: Severity
    source: str
    text: str
    lasts: bool = False
    code: str = ""
    subject: str = ""
    ends: bool = False

    @property
    def key(self) -> tuple[str, str, str]:
        """What it has in common with others of its condition."""
        return condition_key(self.source, self.code, self.subject, self.text)

    def over(self) -> "Event":
        """The event that ends its condition."""
        return replace(self, severity=Severity.NOTICE, text=f"over: {self.text}", lasts=False, ends=True)


@dataclass(frozen=True, slots=True)
class LawFailure:
    """The lab's own control law failed in the tick at t_ns, and the built-in law flies on.

    body: whose; of all, and empty, where it overran: it did not answer in time, which a replay cannot find again and
    takes from here.
    """

    t_ns: int
    law: str
    body: str
    reason: str
    overran: bool

    @property
    def text(self) -> str:
        """In one line."""
        whose = f", {self.body}" if self.body else ""
        return f"control law {self.law}{whose}: {self.reason}; the built-in law flies on"


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The simulated vehicle's true state, as its agent publishes it."""

    t_ns: int
    sysid: int
    pos_lab_m: SingleVec3
    vel_lab_m_s: SingleVec3
    q_lab_from_flu: SingleQuat
    rate_flu_rad_s: SingleVec3
    dist_lab_m_s2: SingleVec3
    on_ground: bool
    armed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """The newest normalised innovation of one source of a drone's navigator, as PX4's EstimatorAidSource3d.

    t_ns: time of the observation. Unit by source: position m, attitudes rad, thrust m/s^2; axes of `lab`, of `flu` for
    thrust; what is not observed is zero. test_ratio: above 1 the observation is inconsistent. rejected: the source is
    not used.
    """

    t_ns: int
    sysid: int
    source: str
    observation: SingleVec3
    innovation: SingleVec3
    innovation_variance: SingleVec3
    test_ratio: SingleVec3
    rejected: bool


@dataclass(frozen=True, slots=True, eq=False)
class SignalRows:
    """K rows of one table of w signals that another recorder wrote, as `gcs-log import` and `join` bring them in.

    t_ns: of the first row; body: whose; names: of the columns. since_s (K,): time of each row after the first, s;
    values (K * w,): row by row; NaN where a column has no value in a row, and no row has none at all.
    """

    t_ns: int
    body: str
    table: str
    names: tuple[str, ...]
    since_s: Scalars
    values: Scalars


@dataclass(frozen=True, slots=True)
class HostReport:
    """The host's report to its ground: other grounds on the lab's bus, faults of the log and the stop button.

    log_trouble, button_trouble: in words; empty while everything is written in time, and the button is there or none is
    configured. exposed: that links of other machines are open without keys, in words; empty while none is.
    """

    other_grounds: tuple[str, ...] = ()
    log_trouble: str = ""
    button_trouble: str = ""
    exposed: str = ""


@dataclass(frozen=True, slots=True)
class UnmetParameter:
    """A parameter that the autopilot `sysid` reads as it boots was written, or found not as wanted, at `t_ns`.

    t_ns: on the ground's clock. Until the autopilot boots after that, it flies with another value than it reports.
    """

    sysid: int
    parameter: str
    t_ns: int


@dataclass(frozen=True, slots=True)
class Tick:
    """One call of `tick(now_ns)`: logged, so that replay makes the same calls at the same times."""

    now_ns: int


@dataclass(frozen=True, slots=True)
class LoopTiming:
    """One control cycle on the machine's clock: frame receipt -> last datagram handed to the link.

    late: the watchdog fired, or the cycle outran the frame spacing.
    """

    frame_seq: int
    latency_s: float
    late: bool


FARTHEST_M = 1000.0
"""No pose of a lab is farther from the cameras' origin: what is, is in other units."""
FORCE_MOST_M_S2 = 157.0
"""16 g along an axis: no accelerometer of an autopilot shows more."""


FROZEN_FRAMES = 5
"""A pose that repeats to the last bit so many times is frozen; fewer are frames that the cameras lost."""


class Rejection(IntEnum):
    """Why one body's pose is not shown; NONE where it is, or where the cameras do not see the body."""

    NONE = 0
    NOT_FINITE = 1
    NO_ROTATION = 2
    TOO_FAR = 3
    FREEZE = 4
    JUMP = 5
    FLIP = 6
    YAW_RATE = 7
    SWAP = 8
    STAMP = 9

    @property
    def text(self) -> str:
        """In words; the empty text for NONE."""
        return _WORDS[self]


def rejection_text(code: int) -> str:
    """In words, of whatever number; one that is none of ours says so."""
    return Rejection(code).text if code in _WORDS else f"reason {code}, of a later version"


_WORDS = {
    Rejection.NONE: "",
    Rejection.NOT_FINITE: "not finite",
    Rejection.NO_ROTATION: "no unit quaternion",
    Rejection.TOO_FAR: f"more than {FARTHEST_M:g} m away (millimetres?)",
    Rejection.FREEZE: "frozen: the same to the last bit",
    Rejection.JUMP: "jumped farther than it can move",
    Rejection.FLIP: "turned over as it cannot",
    Rejection.YAW_RATE: "yawed faster than it can",
    Rejection.SWAP: "exchanged with another body",
    Rejection.STAMP: "stamped with a time it cannot have",
}
