"""Records the true states of a lockstep flight for the oracle; it passes the log's records on unchanged."""

import numpy as np

from formation.messages import Cause, Event, EventCode, OperatorRequest, Phase, PhaseChange, Severity, Verb
from formation.topics import EVENT, MOCAP_EVENT, PHASE, REQUEST, Topic
from gcs.recording import Record
from sim.campaign.oracle import Truth
from sim.scenario import Scenario
from sim.world import T0_NS, World

RECORDED = frozenset(topic.name for topic in (EVENT, MOCAP_EVENT, PHASE, REQUEST))
PLANNED = (Cause.OPERATOR, Cause.START, Cause.AT_HEIGHT, Cause.LANDED)
"""The causes of planned changes of the phase."""


class FlightRecorder:
    """The recorder of one flight: `record` receives the world's records, `sample` is called at every exposure."""

    def __init__(self, scenario: Scenario, log: Record | None) -> None:
        self.planned = True
        self.armed_ever = False
        self._scenario = scenario
        self._log = log
        self._rows: list[list[float]] = []
        self._t_s: list[float] = []
        self._notes: list[tuple[float, bool, str]] = []
        self._log_alarms_s: list[float] = []
        self._armed_s: list[float] = []
        self._stops_s: list[float] = []
        self._arms_s: list[float] = []
        self._log_ill_s: list[tuple[float, float]] = []
        self._ill_since_s: float | None = None

    def record(self, topic: Topic, message: object, t_ns: int) -> None:
        """Receive a record and pass it on to the log."""
        if topic.name in RECORDED:
            self._receive(message, t_ns)
        if self._log is not None:
            self._log(topic, message, t_ns)

    def sample(self, world: World) -> bool:
        """Record every drone's state; returns whether all are on the floor with their motors off."""
        now_ns = world.now_ns
        for event in world.pop_events():
            self._receive(event, now_ns)
        self._stops_s += [(t_ns - T0_NS) * 1e-9 for t_ns in world.stops_beside_ns]
        world.stops_beside_ns.clear()
        self._update_log_fault(world.log_is_ill, (now_ns - T0_NS) * 1e-9)
        row: list[float] = []
        down = True
        for sample in world.samples():
            pos, vel, gain = sample.pos_lab_m.tolist(), sample.vel_lab_m_s.tolist(), sample.motor_gain.tolist()
            (_, x, y, _), age = sample.q_lab_from_flu.tolist(), sample.command_sent_ns
            down = down and not sample.armed and pos[2] < 0.03 and abs(vel[2]) < 0.1
            self.armed_ever = self.armed_ever or sample.armed
            row += (*pos, *vel, 1.0 - 2.0 * (x * x + y * y), float(sample.armed), sample.thrust_n)
            row += sample.q_commanded.tolist()
            row += (
                sample.thrust_commanded,
                np.nan if age is None else (now_ns - age) * 1e-9,
                min(gain),
                max(gain),
                sample.lift_most,
            )
        self._rows.append(row)
        self._t_s.append((now_ns - T0_NS) * 1e-9)
        return down

    def truth(self, onset_ns: int | None) -> Truth:
        """The recorded states and events."""
        vehicles = [v for v in self._scenario.lab.vehicles if v.sysid is not None]
        weights_n = np.array([self._scenario.lab.profile_of(v).weight_n for v in vehicles])
        rows = np.array(self._rows).reshape(len(self._rows), len(vehicles), -1)
        fence = self._scenario.lab.limits.fence
        return Truth(
            names=tuple(v.body for v in vehicles), t_s=np.array(self._t_s),
            pos_m=rows[:, :, 0:3], vel_m_s=rows[:, :, 3:6], up=rows[:, :, 6], armed=rows[:, :, 7] > 0.5,
            thrust=rows[:, :, 8] / weights_n, command=rows[:, :, 9:14], command_age_s=rows[:, :, 14],
            gain_low=rows[:, :, 15], gain_high=rows[:, :, 16],
            lift_most=rows[:, :, 17],
            fence_low_m=np.array(fence.low_m), fence_high_m=np.array(fence.high_m),
            t_onset_s=np.nan if onset_ns is None else (onset_ns - T0_NS) * 1e-9,
            notes=tuple(sorted(self._notes, key=lambda note: note[0])),
            log_alarms_s=tuple(self._log_alarms_s), armed_s=tuple(self._armed_s), stops_s=tuple(sorted(self._stops_s)),
            arms_s=tuple(self._arms_s),
            log_ill_s=tuple(self._log_ill_s),
            planned=self.planned,
        )  # fmt: skip

    def _update_log_fault(self, ill: bool, t_s: float) -> None:
        if not ill:
            self._ill_since_s = None
        elif self._ill_since_s is None:
            self._ill_since_s = self._t_s[-1] if self._t_s else t_s  # since the last sample, when it was well
            self._log_ill_s.append((self._ill_since_s, t_s))
        else:
            self._log_ill_s[-1] = (self._ill_since_s, t_s)

    def _receive(self, message: object, t_ns: int) -> None:
        t_s = (t_ns - T0_NS) * 1e-9
        match message:
            case Event():
                unplanned = message.severity <= Severity.WARNING
                self._notes.append((t_s, unplanned, f"{message.source}: {message.text}"))
                if message.code == EventCode.LOG and not message.ends:
                    self._log_alarms_s.append(t_s)
            case PhaseChange():
                planned = message.code in PLANNED
                self.planned = self.planned and planned
                self._notes.append((t_s, not planned, f"{message.phase.name}: {message.cause}"))
                if message.phase is Phase.ARMED:
                    self._armed_s.append(t_s)
            case OperatorRequest() if message.verb is Verb.STOP:
                self._stops_s.append(t_s)
            case OperatorRequest() if message.verb is Verb.ARM:
                self._arms_s.append(t_s)
