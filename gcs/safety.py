"""Safety at the ground: the facts that its rules decide on, what they find as events, what a campaign can switch off.

The facts: how regularly frames come, the newest estimate, what the links say, what the host reports. Pure. A new safety
rule is a row of formation.safety.rules_table.RULES; a new measure a `Measure` there and its line in
formation.safety.rules; a new fact a field of `Facts`, which `FactGatherer.gather` fills.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from math import exp

import numpy as np
from numpy.typing import NDArray

from formation.config import LabConfig
from formation.control import limits
from formation.control.stack import Stages
from formation.maths.arrays import Float, Quat, Quats, Scalars, Vec3s
from formation.maths.kernel import kernel
from formation.messages import Event, EventCode, HostReport, LabFrame, Severity, rejection_text
from formation.safety.attitude_innovation import AttitudeMonitor
from formation.safety.rules import Facts, FaultChange
from formation.safety.rules_table import BEHIND_HOLD_S, RULE_NAMES, SILENT_S, Measure
from gcs.drones.drone import Drone
from gcs.drones.link_state import Ages, DroneLink
from gcs.drones.telemetry import MEMORY_S, NOWHERE

ARM_IN_AIR = "arm-in-air"
ARM_OTHER_GROUND = "arm-other-ground"
LOG_TROUBLE = "log-trouble"
STOP_REPEAT = "stop-repeat"
SETPOINT_HOLD_OFF = "setpoint-hold-off"
MONITORS = (*RULE_NAMES, *limits.MONITORS, ARM_IN_AIR, ARM_OTHER_GROUND, LOG_TROUBLE, STOP_REPEAT, SETPOINT_HOLD_OFF)
UNHEARD_S = 0.5
"""Nothing of a drone for so long, of the hundred packets a second that it sends, ended before its motion went wrong."""
_EFFECTS = frozenset(
    {
        Measure.UNSEEN_S, Measure.POSITION_ERROR_M, Measure.LEADER_POSITION_ERROR_M, Measure.NOT_OFFBOARD,
        Measure.DISARMED, Measure.MODEL_MISMATCH, Measure.ATTITUDE_INNOVATION_RAD,
    }
)  # fmt: skip


def host_events(before: HostReport, after: HostReport) -> list[Event]:
    """Events for what is new in a host's report, or over. What it reports forbids arming, and touches no control."""
    events = [
        Event(Severity.WARNING, "flight", f"another ground is alive: {name}", code=EventCode.OTHER_GROUND, subject=name)
        for name in after.other_grounds
        if name not in before.other_grounds
    ]
    for old, new in zip(_troubles(before), _troubles(after), strict=True):
        if new.text and new != old:
            events.append(new)
        elif old.text and not new.text:
            events.append(old.over())
    return events


def _troubles(report: HostReport) -> tuple[Event, ...]:
    """The possible faults, as events; the text of one that is not is empty."""
    troubles = (
        ("log", report.log_trouble, EventCode.LOG),
        ("security", report.exposed, EventCode.INSECURE),
        ("stop button", report.button_trouble, EventCode.STOP_BUTTON),
    )
    return tuple(Event(Severity.CRITICAL, source, text, lasts=True, code=code) for source, text, code in troubles)


def with_cause(change: FaultChange, link: DroneLink, rejected: int, now_ns: int) -> str:
    """The text of a fault that begins, with its first cause. rejected: why the mocap rejects its pose (Rejection)."""
    cause = _first_cause(change, link, rejected, now_ns) if change.rule.measure in _EFFECTS else ""
    return f"{change.text} ({cause})" if cause else change.text


def _first_cause(change: FaultChange, link: DroneLink, rejected: int, now_ns: int) -> str:
    if link.guard_words(now_ns):
        return f"its guard: {link.guard_words(now_ns)}"
    if change.rule.measure is not Measure.UNSEEN_S:
        return "nothing is heard of it" if link.ages(now_ns).silent_s > UNHEARD_S else ""
    if rejected:
        return f"the mocap rejects its pose: {rejection_text(rejected)}"
    late = link.ages(now_ns).behind_s > BEHIND_HOLD_S
    return "its telemetry comes late: a slow link, or a busy computer" if late else ""


class OpenAlarms:
    """Turns faults that begin and end into events; those that end while their drone is unheard wait for its word."""

    def __init__(self, drones: Sequence[Drone]) -> None:
        self._drones = {drone.index: drone for drone in drones}
        self._open: dict[tuple[int, str], Event] = {}
        self._begun: dict[tuple[int, str], Event] = {}
        """Faults that go on, as they were reported."""

    @property
    def texts(self) -> tuple[str, ...]:
        """The faults that no rule raises any more, of drones that are still unheard."""
        return tuple(event.text for event in self._open.values())

    def update(self, changes: Sequence[FaultChange], rejected: Sequence[int], now_ns: int) -> list[Event]:
        """Events for faults that began, each with its first cause, and for faults that are over. rejected: why the
        mocap rejects each body's pose."""
        events = list[Event]()
        if not changes and not self._open:
            return events
        for change in changes:
            key = change.vehicle, change.rule.name
            if change.began and key in self._open:
                self._begun[key] = self._open.pop(key)
            elif change.began:
                self._begun[key] = self._event(change, self.text(change, rejected, now_ns))
                events.append(self._begun[key])
            else:
                begun = self._begun.pop(key, None) or self._event(change, change.text)
                if not change.rule.of_swarm and self._is_unheard(change.vehicle, now_ns):
                    self._open[key] = begun
                else:
                    events.append(begun.over())
        ended = [key for key in self._open if not self._is_unheard(key[0], now_ns)]
        return events + [self._open.pop(key).over() for key in ended]

    def text(self, change: FaultChange, rejected: Sequence[int], now_ns: int) -> str:
        """The text of a fault that begins, with its first cause."""
        drone = None if change.rule.of_swarm else self._drones.get(change.vehicle)
        return change.text if drone is None else with_cause(change, drone.link, rejected[change.vehicle], now_ns)

    def _event(self, change: FaultChange, text: str) -> Event:
        rule = change.rule
        return Event(
            rule.severity, "safety", text, lasts=True, code=rule.name, subject="" if rule.of_swarm else change.body
        )

    def _is_unheard(self, vehicle: int, now_ns: int) -> bool:
        drone = self._drones.get(vehicle)
        return drone is not None and drone.link.ages(now_ns).silent_s > SILENT_S


_NO_AGES = Ages(0.0, 0.0, math.nan, math.nan)
_REPORTED = (True, True, False)
"""A body without a link: its ages as of `DroneLink.ages`; armed, off-board, and that its address is used twice."""


@dataclass(slots=True)
class Lateness:
    """Frames by sequence number. A frame is missed when its number never comes, or a newer one overtakes it unused."""

    frames: int = 0
    missed_frames: int = 0
    _seq: int | None = None
    _t_ns: int = 0
    _late: float = 0.0
    _all: float = 0.0

    @property
    def share(self) -> float:
        """The part of about the last second's frames that was missed, 0..1."""
        return self._late / self._all if self._all > 0.0 else 0.0

    def note(self, seq: int, now_ns: int, overtaken: bool) -> None:
        """A frame came; `overtaken`: the one before it was never used. A source that starts again starts again here."""
        missed_frames = int(overtaken)
        if self._seq is not None and seq > self._seq:
            missed_frames += seq - self._seq - 1
        fade = exp(-(now_ns - self._t_ns) * 1e-9 / MEMORY_S)
        self._late = self._late * fade + missed_frames
        self._all = self._all * fade + missed_frames + 1
        self.frames, self.missed_frames = self.frames + 1, self.missed_frames + missed_frames
        self._seq, self._t_ns = seq, now_ns


class FactGatherer:
    """The facts of one lab; what a body has no link for reads as healthy. drones: those with a link."""

    def __init__(self, config: LabConfig, drones: tuple[Drone, ...]) -> None:
        self._names = tuple(v.body for v in config.vehicles)
        self._drones = drones
        self._own = np.array(config.commanded)
        self._commanded = np.isin(np.arange(len(self._names)), self._own)
        self.attitudes = AttitudeMonitor(len(self._names))

    def compare_attitudes(self, frame: LabFrame | None) -> None:
        """The mocap's against the drones' own, as far as they are new."""
        if frame is not None:
            self.attitudes.receive_frame(frame)
        which, stamps_ns, attitudes = list[int](), list[int](), list[Quat]()
        for drone in self._drones:
            own = drone.link.own_estimate.attitudes
            for t_ns, q_lab_from_flu in own:
                which.append(drone.index)
                stamps_ns.append(t_ns)
                attitudes.append(q_lab_from_flu)
            own.clear()
        if which:
            self.attitudes.receive_attitudes(np.array(which), np.array(stamps_ns), np.array(attitudes))

    def level_bias_rad(self) -> Float:
        """Level bias of each commanded vehicle's autopilot (m, 2), 0 where not known; `correct_level` takes it out."""
        return self.attitudes.level_bias_rad(self._own)

    def hover_thrusts_norm(self) -> Scalars:
        """The thrust that hovers each commanded vehicle (m)."""
        return np.array([drone.link.hover_thrust_norm for drone in self._drones])

    def gather(self, stages: Stages | None, late_share: float, now_ns: int) -> Facts:
        """The facts now."""
        n = len(self._names)
        ages_s, own_tilt, own_pos, battery = [_NO_AGES] * n, [math.nan] * n, [NOWHERE] * n, [math.nan] * n
        reported = [_REPORTED] * n
        excluded, landing = np.zeros((2, n), np.bool_)
        for drone in self._drones:
            i, link = drone.index, drone.link
            # Of who lands alone, or rises to join, the rules are those of a landing: the others hold meanwhile.
            excluded[i], landing[i] = drone.excluded, drone.leaving_to is not None or drone.rises
            ages_s[i] = link.ages(now_ns)
            battery[i] = link.telemetry.battery
            own_tilt[i], own_pos[i] = link.own_estimate.at(now_ns)
            reported[i] = (link.armed, link.offboard or drone.joining(now_ns), link.sequence.duplicate(now_ns))
        own_tilts, batteries = np.array([own_tilt, battery])
        heartbeats, silences, behind, ages = np.ascontiguousarray(np.array(ages_s).T)
        arms, streams, twins = np.ascontiguousarray(np.array(reported).T)
        pos, age, model_mismatch, measured = self._seen(stages, now_ns)
        return Facts(
            names=self._names,
            commanded=self._commanded,
            excluded=excluded,
            landing=landing,
            pos_lab_m=pos,
            speed_m_s=measured[0],
            tilt_rad=measured[1],
            age_s=age,
            error_m=measured[2],
            model_mismatch=model_mismatch,
            own_pos_lab_m=np.array(own_pos),
            own_tilt_rad=own_tilts,
            attitude_innovation_rad=self.attitudes.innovation_rad,
            heartbeat_age_s=heartbeats,
            silent_s=silences,
            link_behind_s=behind,
            setpoint_age_s=ages,
            armed=arms,
            offboard=streams,
            battery=batteries,
            duplicate=twins,
            late_share=late_share,
        )

    def _seen(self, stages: Stages | None, now_ns: int) -> tuple[Vec3s, Scalars, Scalars, Float]:
        """Positions (n, 3), ages and model mismatches (n), and speed, tilt and error (3, n)."""
        n = len(self._names)
        if stages is None:
            return np.zeros((n, 3)), np.full(n, np.inf), np.zeros(n), np.zeros((3, n))
        state = stages.state
        measured = _measure(state.vel_lab_m_s, state.q_lab_from_flu, stages.command.e_lead_m, self._own)
        age_s = state.age_s + (now_ns - state.t_ns) * 1e-9
        pos, mismatch = np.ascontiguousarray(state.pos_lab_m), np.ascontiguousarray(state.model_mismatch)
        return pos, age_s, mismatch, measured


def measured_specific_forces(drones: tuple[Drone, ...], frame: LabFrame) -> Vec3s:
    """Mean specific force (n, 3) since the frame before, m/s^2, body FLU; NaN where the drone reports none."""
    force_meas = np.full((len(frame.bodies), 3), np.nan)
    for drone in drones:
        force = drone.link.telemetry.force.pop_mean(frame.t_capture_ns)
        if force is not None:
            force_meas[drone.index] = force
    return force_meas


@kernel
def _measure(vel_lab_m_s: Vec3s, q_lab_from_flu: Quats, e_lead_m: Vec3s, own: NDArray[np.int64]) -> Float:
    """Speed, tilt and error of each body, (3, n); the error of one that is not commanded is zero."""
    out = np.zeros((3, len(vel_lab_m_s)))
    for i in range(len(vel_lab_m_s)):
        x, y = q_lab_from_flu[i, 1], q_lab_from_flu[i, 2]
        vx, vy, vz = vel_lab_m_s[i, 0], vel_lab_m_s[i, 1], vel_lab_m_s[i, 2]
        out[0, i] = np.sqrt(vx * vx + vy * vy + vz * vz)
        out[1, i] = np.arccos(min(max(1.0 - 2.0 * (x * x + y * y), -1.0), 1.0))
    for k in range(len(own)):
        ex, ey, ez = e_lead_m[k, 0], e_lead_m[k, 1], e_lead_m[k, 2]
        out[2, own[k]] = np.sqrt(ex * ex + ey * ey + ez * ez)
    return out


@kernel
def all_finite(pos: Vec3s, vel: Vec3s, q: Quats, rate: Vec3s, thrust: Scalars) -> bool:
    """Whether no number of the estimate's or the target's is NaN or infinite: zero times such a number is NaN."""
    nothing = 0.0
    for i in range(len(pos)):
        for k in range(3):
            nothing += 0.0 * pos[i, k] + 0.0 * vel[i, k]
    for i in range(len(thrust)):
        nothing += 0.0 * thrust[i]
        for k in range(3):
            nothing += 0.0 * rate[i, k]
        for k in range(4):
            nothing += 0.0 * q[i, k]
    return nothing == 0.0
