"""One flight of the campaign: the operator flies the script, then asks for a landing until all are down."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from formation.messages import Cause, Event, EventCode, OperatorRequest, Phase, PhaseChange, Severity, Verb
from formation.topics import EVENT, MOCAP_EVENT, PHASE, REQUEST, Topic
from gcs.recording import Record
from sim.faults.fault import Fault
from sim.lockstep import uncollected
from sim.monitors import WITHOUT_NONE, Without
from sim.proof.oracle import Truth, Verdict, judge
from sim.scenario import Scenario
from sim.world import T0_NS, World

NEVER_FORMED_NS = 14_000_000_000
ASK_AGAIN_NS = 1_000_000_000
PATIENCE_S = 14.0
"""Beyond height / descent rate: ten that a landing may take longer, and the makes' own waits before they disarm."""
AFTER_NS = 300_000_000
AFTER_STOP_NS = 1_900_000_000
"""So long a stop must have lasted; at rest for two seconds, a drone may be armed again."""


@dataclass(frozen=True, slots=True)
class FlightVerdict:
    """A flight's verdict, and how many seconds it was."""

    verdict: Verdict
    duration_s: float


class FlightEnd:
    """When the operator asks for the landing, and when the flight is over."""

    def __init__(self, scenario: Scenario) -> None:
        flight = scenario.lab.flight
        self._formation_ns = round((scenario.formation_s or 4.0) * 1e9)
        self._longest_ns = round((flight.altitude_m / flight.descend_m_s + PATIENCE_S) * 1e9)
        self._land_ns = T0_NS + NEVER_FORMED_NS
        self._formed = False
        self._ask_ns: int | None = None
        self._down_ns: int | None = None
        self._stopped_ns: int | None = None

    def over(self, world: World, *, down: bool, flown: bool) -> bool:
        """Whether it is; asks for the landing when it is time. flown: whether any drone was ever armed."""
        now_ns = world.now_ns
        if world.phase is Phase.FORMATION and not self._formed:
            self._formed, self._land_ns = True, now_ns + self._formation_ns
        if world.phase is Phase.STOPPED and self._stopped_ns is None:
            self._stopped_ns = now_ns
        if now_ns >= self._land_ns and not down and now_ns >= (self._ask_ns or 0):
            self._ask_ns = now_ns + ASK_AGAIN_NS
            world.ask(Verb.LAND)
        if not (down and flown):
            self._down_ns = None
        elif self._down_ns is None:
            self._down_ns = now_ns
        at_rest = self._down_ns is not None and now_ns - self._down_ns > AFTER_NS
        return now_ns > self._land_ns + self._longest_ns or (at_rest and self._settled(world))

    def _settled(self, world: World) -> bool:
        """Whether nothing that is still to come could lift a drone again."""
        if self._stopped_ns is not None:
            return world.now_ns > self._stopped_ns + AFTER_STOP_NS
        return world.now_ns >= self._land_ns or world.phase in (Phase.GROUND, Phase.LAND)


class Flight:
    """A flight that is under way: `advance` until it is over, then `verdict`."""

    def __init__(
        self, scenario: Scenario, seed: int, log: Record | None = None, without: Without = WITHOUT_NONE
    ) -> None:
        """log: where its records go, if anywhere; without: monitors that are switched off."""
        self._recorder = FlightRecorder(scenario, log)
        self.world = World(scenario, seed, self._recorder.record, without)
        self._ending = FlightEnd(scenario)

    @property
    def t_s(self) -> float:
        """How long it has lasted."""
        return (self.world.now_ns - T0_NS) * 1e-9

    def advance(self) -> bool:
        """Fly on to the next exposure of the cameras; whether the flight is over."""
        world, before_ns = self.world, self.world.exposed_ns
        while world.exposed_ns == before_ns:
            world.step()
        down = self._recorder.sample(world)
        return self._ending.over(world, down=down, flown=self._recorder.armed_ever)

    def verdict(self, *, benign: bool = False) -> Verdict:
        """The oracle's, on the flight so far; benign: as `judge` has it."""
        return judge(self._recorder.truth(self.world.faults.first_ns), benign=benign)


def fly(
    scenario: Scenario, seed: int, log: Record | None = None, *, benign: bool = False, without: Without = WITHOUT_NONE
) -> FlightVerdict:
    """Fly a scenario with its faults and judge it."""
    with uncollected():
        flight = Flight(scenario, seed, log, without)
        while not flight.advance():
            pass
    return FlightVerdict(flight.verdict(benign=benign), flight.t_s)


def begins_soon(flight: Flight, faults: Sequence[Fault], within_ns: int) -> bool:
    """Whether the first of the faults begins within that time from now."""
    onsets = flight.world.faults
    return min(onsets.begins_ns(fault) for fault in faults) < flight.world.now_ns + within_ns


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
