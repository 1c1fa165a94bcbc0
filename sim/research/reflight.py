"""A recorded flight, flown again by the host of studies: under its own law or another, later, thinned, or with fewer.

The leader, the frames' times and what acted on the followers are as recorded (sim.research.recorded); the followers are
simulated from the hold before the formation on.
"""

import json
from collections import deque
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from math import inf

import numpy as np

from analysis.load import Flight, from_records
from formation import topics
from formation.codes import FlightResult
from formation.config import LabConfig
from formation.control.presets import Preset
from formation.guidance.plan import Plan
from formation.guidance.shape import configured
from formation.maths import frames
from formation.messages import Cause, LabFrame, Phase, PhaseChange
from gcs.flight import PHASES
from gcs.recording import run_metadata
from sim import lockstep
from sim.research.host import Ground, Host, Vehicles
from sim.research.laws import ChosenLaw, followed_by
from sim.research.recorded import Recorded
from sim.world import OPERATOR_PERIOD_NS, T0_NS

SHOWN_FRAMES = 100
"""So often progress is shown."""


@dataclass(frozen=True, slots=True)
class Change:
    """What is otherwise than recorded: the law (None: its own), a follower less, later frames, fewer of them a second.

    The lab's configuration says the new delay and rate, too, as one would write it for such cameras.
    """

    law: ChosenLaw | None = None
    without: str | None = None
    delay_s: float = 0.0
    rate_hz: float = inf

    @property
    def text(self) -> str:
        """What is otherwise, in words."""
        parts = [] if self.law is None else [self.law.label]
        parts += [] if self.without is None else [f"without {self.without}"]
        parts += [f"{1e3 * self.delay_s:g} ms later"] if self.delay_s else []
        parts += [] if self.rate_hz == inf else [f"{self.rate_hz:g} Hz"]
        return ", ".join(parts) or "nothing changed"

    def applied(self, recorded: Recorded) -> Recorded:
        """The recording as it is flown; RecordedError for a follower that is none."""
        if self.without is not None:
            recorded = recorded.without(self.without)
        lab = recorded.lab if self.law is None else self.law.lab(recorded.lab)
        mocap = lab.mocap.model_copy(
            update={"delay_s": lab.mocap.delay_s + self.delay_s, "rate_hz": min(lab.mocap.rate_hz, self.rate_hz)}
        )
        return replace(recorded, lab=lab.model_copy(update={"mocap": mocap}))


def refly(
    recorded: Recorded, change: Change, progress: Callable[[float], None] = lambda _share: None
) -> tuple[FlightResult, Flight]:
    """Fly it; ABORTED where a rule of safety ended it. ValueError where the law cannot be made. progress: called with
    the share that is flown."""
    flight = _Reflight(recorded, change)
    with lockstep.uncollected():
        return flight.fly(progress)


class _Reflight:
    """One flight again."""

    def __init__(self, before: Recorded, change: Change) -> None:
        self._recorded = recorded = change.applied(before)
        scenario = recorded.scenario.model_copy(update={"lab": recorded.lab})
        self._vehicles = Vehicles(scenario, None, 0, recorded.wind, has_jets=False)  # they are in the recorded wind
        self._vehicles.begin(recorded.flown, recorded.begin_ns)
        self._own_of_leader = self._vehicles.flown["q_flu_from_own"][0]
        law, lab = change.law, recorded.lab.model_copy(update={"control_preset": before.lab.control_preset})
        gains, own = (None, None) if law is None else (followed_by(law, lab), law.own(lab))
        self._ground = Ground(recorded.lab, self._vehicles, gains, own)
        self._metadata = _metadata(recorded.lab, scenario.name, law, gains)
        self._phases, self._attitudes = deque(recorded.phases), deque(recorded.attitudes)
        self._in_transit: deque[tuple[int, LabFrame]] = deque()
        self._late_ns, self._watched_ns = round(change.delay_s * 1e9), recorded.begin_ns
        self._spacing_ns = 0.0 if change.rate_hz == inf else 1e9 / change.rate_hz
        self._phase = Phase.GROUND
        self._plan = self._plan_in(self._phase)
        self._aborted = False

    def fly(self, progress: Callable[[float], None]) -> tuple[FlightResult, Flight]:
        """Frame by frame, until the recording's end."""
        recorded, next_ns = self._recorded, 0.0
        half_ns = 0.5 * float(np.median(np.diff(recorded.capture_ns)))
        for k, capture_ns in enumerate(recorded.capture_ns.tolist()):
            self._deliver(capture_ns)
            if k % SHOWN_FRAMES == 0:
                progress(k / len(recorded.capture_ns))
            if capture_ns > recorded.end_ns or self._aborted:
                break
            if capture_ns >= next_ns - half_ns:
                next_ns = max(next_ns + self._spacing_ns, capture_ns)
                self._in_transit.append((int(recorded.receive_ns[k]) + self._late_ns, self._exposed(k, capture_ns)))
        records = self._ground.records
        return FlightResult.ABORTED if self._aborted else FlightResult.HELD, from_records(self._metadata, records)

    def _exposed(self, k: int, capture_ns: int) -> LabFrame:
        """A frame: as recorded, but for the followers that are simulated."""
        recorded = self._recorded
        pos, q = recorded.pos_lab_m[k].copy(), recorded.q_lab_from_flu[k].copy()
        if capture_ns >= recorded.begin_ns:
            states = self._vehicles.states_at(capture_ns)
            for column, i in enumerate(self._vehicles.bodies.tolist()):
                if i > 0:
                    pos[i] = states[i, 1:4] + recorded.noise_m[k, column]
                    q[i] = frames.canonical(frames.multiply(states[i, 7:11], recorded.turn[k, column]))
        bodies = tuple(vehicle.body for vehicle in recorded.lab.vehicles)
        return LabFrame(k, capture_ns, bodies, pos, q, recorded.seen[k])

    def _deliver(self, until_ns: int) -> None:
        """What has arrived by then, in order: each frame is one turn of control."""
        while self._in_transit and self._in_transit[0][0] <= until_ns and not self._aborted:
            now_ns, frame = self._in_transit.popleft()
            self._enter_phases(now_ns)
            self._receive_attitudes(now_ns)
            stages = self._ground.control(frame, self._plan, now_ns)
            if now_ns >= self._recorded.begin_ns:
                self._vehicles.order(stages.target, now_ns)
            if now_ns - self._watched_ns >= OPERATOR_PERIOD_NS:
                self._watched_ns = now_ns
                self._aborted = self._ground.must_land(self._phase, now_ns)

    def _receive_attitudes(self, now_ns: int) -> None:
        """The drones' own attitudes, where the log has any: the followers' simulated, a commanded leader's recorded."""
        recorded, leads = self._recorded, self._vehicles.bodies[0] == 0
        while self._attitudes and self._attitudes[0][0] <= now_ns:
            _, t_ns, q_lab_from_own = self._attitudes.popleft()
            self._ground.receive_attitudes(t_ns, q_lab_from_own)
        for _, (t_ns, q_lab_from_own) in self._vehicles.attitudes.pop_due(now_ns):
            if leads:
                k = min(int(np.searchsorted(recorded.capture_ns, t_ns)), len(recorded.capture_ns) - 1)
                q_lab_from_own[0] = frames.multiply(recorded.q_lab_from_flu[k, 0], self._own_of_leader)
            if recorded.attitudes:
                self._ground.receive_attitudes(t_ns, q_lab_from_own)

    def _enter_phases(self, now_ns: int) -> None:
        """What the plan became before this turn."""
        while self._phases and self._phases[0][0] < now_ns:
            t_ns, self._phase = self._phases.popleft()
            self._ground.now_ns = max(t_ns, T0_NS)
            self._plan = self._plan_in(self._phase)
        begun_ns = self._recorded.trajectory_ns
        if begun_ns is not None and begun_ns < now_ns and self._phase is Phase.FORMATION:
            self._plan = replace(self._plan, trajectory_start_ns=begun_ns)

    def _plan_in(self, phase: Phase) -> Plan:
        """The phase begins: it is recorded, and every drone led as it says."""
        lab = self._recorded.lab
        self._ground.record(topics.PHASE, PhaseChange(phase, "", Cause.OPERATOR))
        return Plan((PHASES[phase].setpoint(lab.flight),) * len(lab.commanded), configured(lab))


def _metadata(lab: LabConfig, name: str, law: ChosenLaw | None, gains: Preset | None) -> dict[str, str]:
    """What the log of it would say."""
    named = {} if law is None or law.is_preset else {"control_law": law.name}
    if gains is not None:
        named["gains"] = json.dumps({vehicle.profile: asdict(gains) for vehicle in lab.vehicles})
    return run_metadata(lab, T0_NS) | {"scenario": name, "host": Host.STUDY} | named
