"""GcsCore, the ground without its inputs and outputs: messages in, datagrams and records out, time an argument.

The daemon, the lockstep simulation and the replay of a log all drive this one class. A frame makes a tick due at once;
ticks without a frame only watch, answer and repeat. The ground's heartbeat rides on ticks with a frame alone: it is
earned by the control, so that a drone hears it stop when control stops.
"""

import json
from typing import Any, NamedTuple

import numpy as np

from formation import topics
from formation.config import LabConfig
from formation.control import limits
from formation.control.presets import Preset
from formation.control.stack import ControlStack, Stages
from formation.messages import (
    Datagram,
    Event,
    HostReport,
    LabFrame,
    LawFailure,
    OperatorReply,
    OperatorRequest,
    Phase,
    Severity,
    Verb,
)
from formation.own_law.guard import LawGuard, unlimited
from formation.rejection import rejection_text
from formation.safety import rules
from formation.safety.phases import STREAMING, Trigger
from formation.safety.rules import Facts
from formation.topics import Topic
from gcs import reforming
from gcs.drones.checks import warnings
from gcs.drones.commands import RETRY_NS
from gcs.drones.drone import Drone
from gcs.drones.goal import Goal
from gcs.drones.link_state import DroneLink
from gcs.drones.telemetry import NEVER_NS, ground_heartbeat
from gcs.facts import FactGatherer, all_finite, felt_forces
from gcs.flight import Flight
from gcs.lateness import Lateness
from gcs.mocap.autopilot_poses import streams
from gcs.operator import armed_text, done_text
from gcs.own_law import own_laws
from gcs.safety import adoption, monitors
from gcs.safety.blind import BlindFlight
from gcs.safety.host import Host
from gcs.safety.permissions import Permissions
from gcs.state.counters import counters
from gcs.state.swarm import About, swarm_state
from wire.link_messages.address import ground_address
from wire.mavlink.framing import packed
from wire.refusals import Refusals

HEARTBEAT_NS = 1_000_000_000
POSE_NS = 20_000_000
WATCHDOG_FRAMES = 3.0
PICK_UP_NS = 400_000_000
"""How often after an adoption the control begins anew from where the drones are, until all follow it."""


class BrokenInvariantError(RuntimeError):
    """The core found itself wrong; the host must end, so that setpoints stop and the agents land the drones."""


class Outgoing(NamedTuple):
    """What one tick wants sent and recorded, each in order."""

    datagrams: tuple[Datagram, ...]
    replies: tuple[OperatorReply, ...]
    records: tuple[tuple[Topic, object], ...]


class GcsCore:
    """One lab's ground. Not thread-safe; `now_ns` never goes back."""

    def __init__(
        self, config: LabConfig, t0_ns: int, epoch: int = 0, without: frozenset[str] = frozenset(),
        gains: Preset | None = None, law_guard: LawGuard = unlimited,
    ) -> None:  # fmt: skip
        """epoch: which of the lab's grounds this is; one started anew is another.

        without: those of gcs.safety.monitors.MONITORS that a campaign switches off; ValueError for other names.
        gains: in the place of the lab's preset. law_guard: bounds how long the lab's own law may take.
        """
        monitors.check(without)
        self._config = config
        self._t0_ns, self._epoch = t0_ns, epoch
        self._without, self._gains = without, gains
        self._heartbeat = ground_heartbeat(epoch)
        self._host = Host(without)
        self._feeds_pose = config.mocap.source != "mavlink"
        self._drones = tuple(Drone(i, self._link(config, i)) for i in config.commanded)
        self._links = {drone.link.sysid: drone.link for drone in self._drones}
        for link in self._links.values() if monitors.STOP_REPEAT in without else ():
            link.commands.urgent_retry_ns = RETRY_NS
        self._own = own_laws(config, law_guard)
        self._stack = self._fresh_stack()
        self._law_failures: list[LawFailure] = []
        self._pick_up_ns: int | None = None
        self._flight = Flight(config, self._drones, t0_ns)
        self._gatherer = FactGatherer(config, self._drones)
        self._permissions = Permissions(config, self._drones, self._flight, self._host, without)
        self._rule_state = rules.start(len(config.vehicles))
        self._rules_on = rules.switched_on(without)
        self._lateness = Lateness()
        self._blind = BlindFlight(self._drones, len(config.vehicles), on=monitors.LEVEL_BLIND not in without)
        self._stages: Stages | None = None
        self._frame: LabFrame | None = None
        self._bodies = tuple(v.body for v in config.vehicles)
        self._rejected = np.zeros(len(self._bodies), np.uint8)
        self._newest_capture_ns = NEVER_NS
        self._requests: list[OperatorRequest] = []
        self._arming_request: int | None = None
        self._tick_ns = t0_ns
        self._due = False
        self._heartbeat_due_ns = t0_ns
        self._pose_due_ns = t0_ns
        self._watchdog_ns = round(WATCHDOG_FRAMES / config.mocap.rate_hz * 1e9)
        self._deadline_ns = t0_ns + self._watchdog_ns
        self._stale_frames = 0
        self._refused_frames = Refusals()
        self._strays = 0

    def _fresh_stack(self) -> ControlStack:
        profiles = tuple(self._config.profile_of(vehicle) for vehicle in self._config.vehicles)
        return ControlStack(self._config, profiles, self._gains, self._without & set(limits.MONITORS), self._own)

    def _link(self, config: LabConfig, i: int) -> DroneLink:
        vehicle = config.vehicles[i]
        origin = config.origin if self._feeds_pose else None
        sysid, profile, address = vehicle.sysid or 0, config.profile_of(vehicle), ground_address(self._epoch)
        return DroneLink(vehicle, sysid, profile, streams(config), origin, address)

    @property
    def phase(self) -> Phase:
        """The swarm's phase."""
        return self._flight.phase

    def receive(self, message: LabFrame | Datagram | OperatorRequest | HostReport, now_ns: int) -> None:
        """Take one input in. Of frames the newest wins; requests wait for the tick, which is then due at once."""
        match message:
            case LabFrame():
                self._receive_frame(message, now_ns)
            case Datagram():
                link = self._links.get(message.sysid)
                if link is None:
                    self._strays += 1
                else:
                    link.receive(message.data, now_ns, message.superseded)
                    self._due = self._due or link.has_answers
            case OperatorRequest():
                self._requests.append(message)
                self._due = True
            case HostReport():
                self._flight.events += self._host.take(message)
                self._due = True

    def next_deadline_ns(self) -> int:
        """When `tick` is due if nothing arrives: at once if there is something to do, else when a frame is overdue.

        While a stop is not confirmed by every drone, when it is to be repeated.
        """
        return self._tick_ns if self._due else self._deadline_ns

    def tick(self, now_ns: int) -> Outgoing:
        """Control on a fresh frame, safety and the flight's progress always. Raises BrokenInvariantError."""
        self._tick_ns, self._due = now_ns, False
        self._pick_up(now_ns)
        frame, stack = self._take_frame(), self._stack
        stages = None if frame is None else self._control(frame, now_ns)
        self._gatherer.compare_attitudes(frame)
        facts, phase = self._facts(now_ns), self._flight.phase
        self._rule_state, verdict = rules.assess(
            self._rule_state, facts, phase, self._config.limits, now_ns, self._rules_on
        )
        self._flight.judge(verdict, now_ns)
        replies = [reply for request in self._take_requests() for reply in self._answer(request, now_ns)]
        led = stages if self._stack is stack else None  # drones that fly are sent nothing that was computed for rest
        self._flight.proceed(led, now_ns)
        replies += self._answer_arming(now_ns)
        datagrams = self._datagrams(frame, led, now_ns)
        self._deadline_ns = self._next_look_ns(now_ns)
        return Outgoing(datagrams=datagrams, replies=tuple(replies), records=self._records(stages))

    def _next_look_ns(self, now_ns: int) -> int:
        """When a frame is overdue, or before, when an urgent command is to be repeated."""
        urgent = (d.link.commands.urgent_ns for d in self._drones if d.goal is Goal.CUT)
        return min((now_ns + self._watchdog_ns, *(due_ns for due_ns in urgent if due_ns is not None)))

    def _pick_up(self, now_ns: int) -> None:
        """Begin the control anew from where drones just adopted are, if they do not follow it yet."""
        if self._pick_up_ns is None or now_ns < self._pick_up_ns:
            return
        self._pick_up_ns = None
        if self.phase is Phase.HOLD and any(drone.awaited(now_ns) for drone in self._drones):
            self._stack, self._pick_up_ns = self._fresh_stack(), now_ns + PICK_UP_NS

    def state(self, now_ns: int) -> dict[str, Any]:
        """Everything an operator may want to see, as JSON has it; reading it changes nothing."""
        grounded, late = self.phase is Phase.GROUND, self._lateness.share
        facts = self._gatherer.gather(self._stages, late, now_ns, grounded or self.phase is Phase.ARMED)
        refusals = self._permissions.arming(facts, now_ns) if grounded else ()
        links, refused = self._links.values(), self._refused_frames.count
        about = About(
            t_s=(now_ns - self._t0_ns) * 1e-9,
            epoch=self._epoch,
            host=self._host,
            counters=counters(self._lateness, self._stale_frames, refused, self._strays, links),
            rejected={b: rejection_text(c) for b, c in zip(self._bodies, self._rejected.tolist(), strict=True) if c},
            refusals=refusals,
            allowed=self._permissions.allowed(facts, self._stages, refusals, now_ns),
        )
        return swarm_state(self._flight, self._drones, facts, self._stages, self._config, about, now_ns)

    def status(self, now_ns: int) -> str:
        """The same as text: what `gcs status --json` prints."""
        return json.dumps(self.state(now_ns))

    def _receive_frame(self, frame: LabFrame, now_ns: int) -> None:
        if frame.bodies != self._bodies:
            self._refused_frames.note("mocap", "frame of other bodies than the lab's", now_ns)
            return
        if frame.t_capture_ns <= self._newest_capture_ns:
            self._stale_frames += 1
            return
        self._newest_capture_ns = frame.t_capture_ns
        self._lateness.note(frame.seq, now_ns, overtaken=self._frame is not None)
        self._frame, self._due = frame, True
        self._rejected = frame.rejected

    def _take_frame(self) -> LabFrame | None:
        frame, self._frame = self._frame, None
        return frame

    def _take_requests(self) -> list[OperatorRequest]:
        requests, self._requests = self._requests, []
        return requests

    def _control(self, frame: LabFrame, now_ns: int) -> Stages:
        hover = np.array([drone.link.hover_thrust_norm for drone in self._drones])
        self._stack.forget(self._blind.look(frame))
        stages = self._stack.step(now_ns, frame, self._flight.plan(), hover, felt_forces(self._drones, frame))
        self._law_failures = self._stack.law_failures()
        self._flight.events += [Event(Severity.ERROR, "control", failure.text) for failure in self._law_failures]
        state, target = stages.state, stages.target
        if not all_finite(
            state.pos_lab_m, state.vel_lab_m_s, target.q_lab_from_flu, target.rate_flu_rad_s, target.thrust_norm
        ):
            raise BrokenInvariantError(f"frame {frame.seq}: the control's estimate or target is not finite")
        self._stages = self._blind.kept(stages, frame.t_capture_ns, hover)
        return self._stages

    def _answer(self, request: OperatorRequest, now_ns: int) -> list[OperatorReply]:
        """The answer; none yet to `arm`, which is answered when every drone has armed, or has not."""
        if request.verb is Verb.STATUS:
            return [OperatorReply(request.id, True, self.status(now_ns))]
        facts = self._gatherer.gather(self._stages, self._lateness.share, now_ns, asked_to_arm=True)
        refusals = self._permissions.refusals(request.verb, facts, self._stages, now_ns)
        if not refusals and request.verb in reforming.CHANGES:
            refusals = reforming.ask(request, self._flight, self._facts(now_ns), self._stages, now_ns)
        elif not refusals:
            refused = self._carry_out(request.verb, now_ns)
            refusals = (refused,) if refused else ()
        if refusals:
            text = "; ".join(refusals)
            self._flight.events.append(Event(Severity.WARNING, "operator", f"{request.verb} refused: {text}"))
            return [OperatorReply(request.id, False, text)]
        if request.verb is Verb.ARM:
            self._arming_request = request.id
            return []
        return [OperatorReply(request.id, True, done_text(self._flight))]

    def _carry_out(self, verb: Verb, now_ns: int) -> str:
        """Pull the verb's trigger: the empty text, or why it means nothing now."""
        adopted = verb is Verb.ADOPT and self.phase is Phase.GROUND
        down = adoption.landing_text(self._drones) if adopted else ""
        if down:
            return self._flight.pull(Trigger.LAND, down, now_ns)
        refused = self._flight.pull(Trigger(verb.value), f"operator: {verb}", now_ns)
        if adopted and not refused:
            self._stack, self._pick_up_ns = self._fresh_stack(), now_ns + PICK_UP_NS
        return refused

    def _answer_arming(self, now_ns: int) -> list[OperatorReply]:
        request, flight = self._arming_request, self._flight
        if request is None or (flight.phase is Phase.ARMED and not flight.armed):
            return []
        self._arming_request = None
        if flight.phase is Phase.ARMED:
            return [OperatorReply(request, True, armed_text(flight, now_ns))]
        return [OperatorReply(request, False, flight.cause)]

    def _facts(self, now_ns: int) -> Facts:
        return self._gatherer.gather(self._stages, self._lateness.share, now_ns)

    def _datagrams(self, frame: LabFrame | None, stages: Stages | None, now_ns: int) -> tuple[Datagram, ...]:
        """One datagram a drone where it holds them all, the setpoint first."""
        beat = frame is not None and now_ns >= self._heartbeat_due_ns
        pose = self._feeds_pose and frame is not None and now_ns >= self._pose_due_ns
        if beat:
            self._heartbeat_due_ns = now_ns + HEARTBEAT_NS
        if pose:  # a steady 50 Hz out of frames that jitter
            self._pose_due_ns = max(self._pose_due_ns + POSE_NS, now_ns)
        streaming = stages is not None and self.phase in STREAMING
        datagrams = []
        for i, drone in enumerate(self._drones):
            link, parts = drone.link, []
            if streaming and frame is not None and stages is not None and drone.flown and not self._blind.mutes(i):
                target = stages.target
                told = self._gatherer.told(drone.index, target.q_lab_from_flu[i])
                turn, thrust_norm = target.rate_flu_rad_s[i], float(target.thrust_norm[i])
                parts.append(link.setpoint(frame.t_capture_ns, told, turn, thrust_norm))
            if pose and frame is not None and frame.seen[drone.index]:
                at = drone.index
                parts.append(link.pose(frame.t_capture_ns, frame.pos_lab_m[at], frame.q_lab_from_flu[at]))
            if beat:
                parts.append(link.codec.encode(self._heartbeat))
            parts += [link.codec.encode(message) for message in link.due(now_ns)]
            datagrams += [Datagram(link.sysid, data) for data in packed(b"".join(parts))]
        return tuple(datagrams)

    def _records(self, stages: Stages | None) -> tuple[tuple[Topic, object], ...]:
        records: list[tuple[Topic, object]] = []
        if stages is not None:
            records += [
                (topics.STATE, stages.state),
                (topics.REFERENCE, stages.reference),
                (topics.COMMAND, stages.command),
                (topics.TARGET, stages.target),
                *((topics.LAW_FAILURE, failure) for failure in self._law_failures),
            ]
        flight = self._flight
        records += [(topics.PHASE, change) for change in flight.changes]
        events, flight.events, flight.changes = flight.events, [], []
        events += self._refused_frames.due(self._tick_ns)
        for drone in self._drones:
            events += self._tell(drone)
        return (*records, *((topics.EVENT, event) for event in events))

    def _tell(self, drone: Drone) -> list[Event]:
        """What the drone said since the last tick and, once its parameters are read, what is amiss with them."""
        link = drone.link
        events, link.events = link.events, []
        if not drone.checked and link.model is not None and not link.parameters.reading:
            drone.checked = True
            events += [Event(Severity.WARNING, link.name, text) for text in warnings(link, self._feeds_pose)]
        return events
