"""The state that a core publishes ten times a second (wire.ground_state): phase, what may come next, drones. Pure."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from formation.config import LabConfig
from formation.control.stack import Stages
from formation.maths.arrays import Float, Scalars
from formation.maths.frames import rotate_about_z
from formation.messages import HostReport, Phase, Verb
from formation.reasons import Reject
from formation.safety.phases import STREAMING
from formation.safety.rules import Facts
from formation.safety.rules_table import UNSEEN_S
from gcs.drones.drone import Drone
from gcs.flight import Flight
from wire.ground_state import Counters, DroneState, GroundState, ObservedBody


@dataclass(frozen=True, slots=True)
class About:
    """The ground itself: the time since its start, s; its session; its host's report; its counters.

    rejected: why the pose validator rejects a body now, by body.
    allowed: by verb, every reason against it now; none where it may be asked.
    """

    t_s: float
    session: int
    host: HostReport
    counters: Counters
    rejected: Mapping[str, str]
    allowed: Mapping[str, tuple[Reject, ...]]


def ground_state(
    flight: Flight, drones: Sequence[Drone], facts: Facts, stages: Stages | None, config: LabConfig, about: About,
    now_ns: int,
) -> GroundState:  # fmt: skip
    """The whole state but the host's part, for people and scripts."""
    numbers = _Numbers(facts, stages, config, leads=flight.phase in STREAMING)
    (path, t_s), end_ns = flight.trajectory_progress(now_ns), flight.landing_end_ns
    start, arming = flight.trajectory_from, about.allowed[Verb.ARM] if flight.phase is Phase.GROUND else ()
    return GroundState(
        phase=flight.phase,
        cause=flight.cause,
        cause_code=flight.cause_code,
        t_s=round(about.t_s, 3),
        phase_s=round((now_ns - flight.entered_ns) * 1e-9, 2),
        ground_session=about.session,
        log_trouble=about.host.log_trouble,
        button_trouble=about.host.button_trouble,
        armed=flight.armed,
        not_landed=flight.not_landed,
        open_alarms=flight.alarms.texts,
        allowed={verb: tuple(reject.text for reject in rejects) for verb, rejects in about.allowed.items()},
        reject_codes={verb: tuple(one.reason.code for one in rejects) for verb, rejects in about.allowed.items()},
        trajectory=flight.trajectory_name,
        trajectory_started=flight.trajectory_start_ns is not None,
        trajectory_done=flight.trajectory_done(now_ns),
        trajectory_s=None if path is None else (round(min(t_s, path.duration_s), 1), round(path.duration_s, 1)),
        trajectory_from=None if start is None else tuple(start.round(3).tolist()),
        landing_left_s=None if end_ns is None else round(max((end_ns - now_ns) * 1e-9, 0.0), 1),
        shape=flight.shape.name,
        slots_lead_m=tuple((round(x, 3), round(y, 3), round(z, 3)) for x, y, z in flight.shape.offset_lead_m),
        drones=tuple(
            _drone_state(drone, m, numbers, about.rejected.get(drone.link.name), now_ns)
            for m, drone in enumerate(drones)
        ),
        observed=tuple(
            ObservedBody(name, numbers.pos[i], numbers.q[i], numbers.age_s[i])
            for i, name in enumerate(facts.names)
            if not facts.commanded[i]
        ),
        leader_yaw_rad=numbers.leader_yaw_rad,
        battery_levels=(config.limits.battery_low_share, config.limits.battery_empty_share),
        rejected=about.rejected,
        prearm_failures=tuple(reject.text for reject in arming),
        counters=about.counters,
    )


class _Numbers:
    """The numbers of the n bodies and the m references in the state; rounded all at once, not one at a time."""

    def __init__(self, facts: Facts, stages: Stages | None, config: LabConfig, *, leads: bool) -> None:
        """leads: whether drones are led anywhere now; else there are no references."""
        n = len(facts.names)
        self.seen = seen = (facts.age_s <= UNSEEN_S).tolist()  # a longer extrapolation is no position
        self.pos = _seen_rows(facts.pos_lab_m, seen)
        self.q: list[Any] = [None] * n
        self.reference: list[Any] | None = None
        self.leader_yaw_rad: float | None = None
        if stages is not None:
            self.q = _seen_rows(stages.state.q_lab_from_flu, seen)
            self.reference = list(map(tuple, reference_lab_m(stages).round(3).tolist())) if leads else None
            self.leader_yaw_rad = round(float(stages.state.yaw_rad[0]), 4) if seen[0] else None
        fence = config.limits.fence
        walls = np.hstack((facts.pos_lab_m - np.array(fence.low_m), np.array(fence.high_m) - facts.pos_lab_m))
        # The floor is the third of the six: the lower wall along z.
        self.margin_m = walls.min(axis=1).round(3).tolist()
        self.margin_standing_m = np.delete(walls, 2, axis=1).min(axis=1).round(3).tolist()
        error_m = facts.error_m.round(4).tolist()
        self.error_m: list[float | None] = [x if ok else None for x, ok in zip(error_m, seen, strict=True)]
        self.age_s = _rounded(facts.age_s, 3)
        self.heartbeat_age_s = _rounded(facts.heartbeat_age_s, 2)
        self.battery = _rounded(facts.battery, 3)
        self.link_behind_s = _rounded(facts.link_behind_s, 3)
        self.setpoint_age_s = _rounded(facts.setpoint_age_s, 4)

    def fence_margin_m(self, i: int, *, on_floor: bool) -> float | None:
        """To the nearest wall; for a drone that stands, the floor is none."""
        if not self.seen[i]:
            return None
        margin: float = (self.margin_standing_m if on_floor else self.margin_m)[i]
        return margin


def reference_lab_m(stages: Stages) -> Float:
    """Where each of the m commanded drones should be now, (m, 3)."""
    reference = stages.reference
    return np.asarray(reference.origin_lab_m + rotate_about_z(reference.heading_rad, reference.slot_lead_m))


def _drone_state(drone: Drone, m: int, numbers: _Numbers, rejected: str | None, now_ns: int) -> DroneState:
    link, i = drone.link, drone.index
    disarms_in_s = drone.disarms_in_s(now_ns)
    offset_ns, stopped_ns = link.clock.offset_ns, drone.stopped_ns
    return DroneState(
        sysid=link.sysid,
        body=link.name,
        autopilot=None if link.model is None else link.model.name,
        armed=link.armed,
        disarms_in_s=None if disarms_in_s is None else round(disarms_in_s, 1),
        mode=link.mode,
        goal=drone.row.goal,
        piloted=drone.piloted,
        landed=link.telemetry.landed.name,
        stopped_ms=None if stopped_ns is None else round((stopped_ns - drone.since_ns) * 1e-6, 1),
        pos_lab_m=numbers.pos[i],
        q_lab_from_flu=numbers.q[i],
        reference_lab_m=None if numbers.reference is None or not drone.flown else numbers.reference[m],
        error_m=numbers.error_m[i],
        fence_margin_m=numbers.fence_margin_m(i, on_floor=not (link.armed and drone.floor.lifted)),
        age_s=numbers.age_s[i],
        heartbeat_age_s=numbers.heartbeat_age_s[i],
        battery=numbers.battery[i],
        battery_v=_number(link.telemetry.battery_v, 2),
        link_behind_s=numbers.link_behind_s[i],
        superseded=link.sequence.superseded,
        setpoint_age_s=numbers.setpoint_age_s[i],
        clock_offset_s=None if offset_ns is None else round(offset_ns * 1e-9, 6),
        loss=round(max(link.sequence.loss, link.telemetry.drop_rate), 4),
        rejected=rejected,
        excluded=drone.excluded,
    )


def _seen_rows(values: Float, seen: Sequence[bool]) -> list[Any]:
    """Each row as a tuple, rounded; None for a body that is not seen."""
    return [tuple(row) if ok else None for row, ok in zip(values.round(4).tolist(), seen, strict=True)]


def _rounded(values: Scalars, digits: int) -> list[float | None]:
    """Each as `_number` has it."""
    known = np.isfinite(values).tolist()
    return [x if ok else None for x, ok in zip(values.round(digits).tolist(), known, strict=True)]


def _number(value: float, digits: int) -> float | None:
    """A number for JSON: None where it is not finite."""
    return round(value, digits) if math.isfinite(value) else None
