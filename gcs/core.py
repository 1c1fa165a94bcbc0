"""GcsCore, the ground without its inputs and outputs: messages in, datagrams and records out, time an argument.

The daemon, the lockstep simulation and the replay of a log all drive this one class. A frame makes a tick due at once;
ticks without a frame only watch, answer and repeat. The ground's heartbeat rides on ticks with a frame alone: it is
earned by the control, so that a drone hears it stop when control stops.
"""

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from formation import topics
from formation.config import LabConfig
from formation.control.limits.target import SetpointHoldOff
from formation.control.presets import Preset
from formation.control.stack import ControlStack, Stages
from formation.guidance.plan import Plan
from formation.messages import (
    Cause,
    Datagram,
    Event,
    EventCode,
    HostReport,
    LabFrame,
    LawFailure,
    OperatorReply,
    OperatorRequest,
    Phase,
    Severity,
    UnmetParameter,
    Verb,
    rejection_text,
)
from formation.own_law.flight import OwnLaws
from formation.own_law.law import Answer, LawGuard, unlimited
from formation.reasons import Reject
from formation.safety import rules
from formation.safety.phases import CHANGES_NO_PHASE, STREAMING, Trigger
from formation.safety.rules import Facts
from formation.topics import Topic
from gcs import formation_change, spare
from gcs.alarms import ACKNOWLEDGED
from gcs.drones.autopilot_model import streams
from gcs.drones.drone import Drone
from gcs.drones.link_state import DroneLink
from gcs.drones.packets import Packets
from gcs.drones.protocols import COMMAND_RETRY_NS
from gcs.drones.stages import Stage
from gcs.drones.telemetry import NEVER_NS
from gcs.flight import Flight, armed_text, done_text
from gcs.formation_change import Judged
from gcs.landing import takeover_text
from gcs.permissions import Situation, allowed, out_of_turn, parameter_warnings, reject_reasons
from gcs.safety import (
    LOG_TROUBLE,
    SETPOINT_HOLD_OFF,
    STOP_REPEAT,
    FactGatherer,
    Lateness,
    all_finite,
    host_events,
    measured_specific_forces,
)
from gcs.spare import Spare
from gcs.state import About, ground_state
from wire.ground_state import Counters, GroundState
from wire.lab_surroundings import law_of, printing_to_stderr
from wire.link_messages import ground_address
from wire.rejections import RejectionLog

REINITIALISE_NS = 400_000_000
"""Period of reinitialising the control after a takeover, until every drone follows it."""


class BrokenInvariantError(RuntimeError):
    """The core found itself wrong; the host must end, so that setpoints stop and the agents land the drones."""


class Outgoing(NamedTuple):
    """The output of one tick, to be sent and recorded, each in order."""

    datagrams: tuple[Datagram, ...]
    replies: tuple[OperatorReply, ...]
    records: tuple[tuple[Topic, object], ...]


class GcsCore:
    """One lab's ground. Not thread-safe; `now_ns` never goes back."""

    def __init__(
        self, config: LabConfig, t0_ns: int, session: int = 0, without: frozenset[str] = frozenset(),
        gains: Preset | None = None, law_guard: LawGuard = unlimited,
    ) -> None:  # fmt: skip
        """session: the ground session; a ground that is started again has another one.

        without: those of gcs.safety.MONITORS that a campaign switches off.
        gains: instead of the lab's preset. law_guard: limits the computing time of the lab's own law.
        """
        self._config = config
        self._t0_ns, self._session = t0_ns, session
        self._without, self._gains = without, gains
        self._host = HostReport()
        self._drones = tuple(Drone(i, self._link(i, config.vehicles[i].sysid or 0)) for i in config.commanded)
        self._links = {drone.link.sysid: drone.link for drone in self._drones}
        self._packets = Packets(self._drones, session, t0_ns)
        self._hold_off = SetpointHoldOff(config.commanded, len(config.vehicles), on=SETPOINT_HOLD_OFF not in without)
        self._own = own_laws(config, law_guard)
        self._stack = self._fresh_stack()
        self._law_failures: list[LawFailure] = []
        self._reinitialise_at_ns: int | None = None
        self._flight = Flight(config, self._drones, t0_ns)
        self._gatherer = FactGatherer(config, self._drones)
        self._rule_state = rules.start(len(config.vehicles))
        self._rules_on = rules.switched_on(without)
        self._lateness = Lateness()
        self._stages: Stages | None = None
        self._frame: LabFrame | None = None
        self._bodies = tuple(v.body for v in config.vehicles)
        self._rejected = np.zeros(len(self._bodies), np.uint8)
        self._newest_capture_ns = NEVER_NS
        self._requests: list[OperatorRequest] = []
        self._stops: list[OperatorRequest] = []
        self._arming_request: int | None = None
        self._spare: Spare | None = None
        self._unmet: list[UnmetParameter] = []
        self._tick_ns = t0_ns
        self._due = False
        self.watchdog_ns = round(3.0 / config.mocap.rate_hz * 1e9)
        """Without a frame for so long, three periods, the next one is overdue."""
        self._deadline_ns = t0_ns + self.watchdog_ns
        self._stale_frames = 0
        self._rejected_frames = RejectionLog()
        self._strays = 0

    def _fresh_stack(self) -> ControlStack:
        profiles = tuple(self._config.profile_of(vehicle) for vehicle in self._config.vehicles)
        return ControlStack(self._config, profiles, self._gains, self._without, self._own, self._hold_off)

    def _link(self, i: int, sysid: int) -> DroneLink:
        config, vehicle, address = self._config, self._config.vehicles[i], ground_address(self._session)
        link = DroneLink(vehicle, sysid, config.profile_of(vehicle), streams(config), config.origin, address)
        if STOP_REPEAT in self._without:
            link.commands.urgent_retry_ns = COMMAND_RETRY_NS
        return link

    @property
    def phase(self) -> Phase:
        """The swarm's phase."""
        return self._flight.phase

    def receive(
        self, message: LabFrame | Datagram | OperatorRequest | HostReport | UnmetParameter, now_ns: int
    ) -> None:
        """Receive one input. A newer frame replaces an older one; a request makes the tick due at once."""
        match message:
            case LabFrame():
                self._receive_frame(message, now_ns)
            case Datagram():
                link = self._links.get(message.sysid)
                if link is None:
                    self._strays += 1
                else:
                    link.receive(message.data, now_ns, message.superseded)
                    self._due = self._due or bool(link.answers)
            case OperatorRequest():
                (self._stops if message.verb is Verb.STOP else self._requests).append(message)
                self._due = True
            case HostReport():
                before, self._host = self._host, message
                if LOG_TROUBLE in self._without:
                    self._host = replace(message, log_trouble="")
                self._flight.events += host_events(before, self._host)
                self._due = True
            case UnmetParameter():
                self._unmet.append(message)
                if message.sysid in self._links:
                    self._links[message.sysid].boot_parameters.note_unmet(message.parameter, message.t_ns)

    def next_deadline_ns(self) -> int:
        """When `tick` is due if nothing arrives: at once if there is something to do, else when a frame is overdue.

        While a stop is not confirmed by every drone, when it is to be repeated.
        """
        return self._tick_ns if self._due else self._deadline_ns

    def tick(self, now_ns: int) -> Outgoing:
        """Control on a fresh frame, safety and the flight's progress always. Raises BrokenInvariantError.

        A stop has a tick of its own, before everything else; what else is due then has the next one, at once.
        """
        self._tick_ns, self._due = now_ns, False
        if self._stops:
            return self.stop(now_ns)
        self._reinitialise(now_ns)
        frame, self._frame = self._frame, None
        stack, plan = self._stack, self._flight.plan()
        self._gatherer.compare_attitudes(frame)
        stages = None if frame is None else self._control(frame, plan, now_ns)
        facts, phase = self._facts(now_ns), self._flight.phase
        self._rule_state, verdict = rules.assess(
            self._rule_state, facts, phase, self._config.limits, now_ns, self._rules_on
        )
        self._flight.judge(verdict, self._rejected.tolist(), now_ns)
        requests, self._requests = self._requests, []
        replies = [reply for request in requests for reply in self._answer(request, now_ns)]
        # After a reinitialisation nothing is sent that was computed for drones at rest.
        current = stages if self._stack is stack else None
        self._flight.update(current, now_ns)
        replies += self._answer_arming(now_ns) + self._answer_spare(now_ns)
        streamed = None if current is None or self._flight.phase not in STREAMING else current.target
        datagrams = self._packets.due(frame, streamed, now_ns)
        self._deadline_ns = self._compute_deadline_ns(now_ns)
        return Outgoing(datagrams=datagrams, replies=tuple(replies), records=self._records(stages))

    def stop(self, now_ns: int) -> Outgoing:
        """Cut every drone's motors. Nothing is judged, measured or computed before, and nothing can reject it."""
        stops, self._stops = self._stops, []
        self._flight.stop(now_ns)
        datagrams = self._packets.due(None, None, now_ns)
        self._deadline_ns = self._compute_deadline_ns(now_ns)
        self._due = self._frame is not None or bool(self._requests) or self._arming_request is not None
        replies = tuple(OperatorReply(request.id, True, done_text(self._flight)) for request in stops)
        return Outgoing(datagrams, replies, self._records(None))

    def _compute_deadline_ns(self, now_ns: int) -> int:
        """When the next frame is overdue, or an urgent command must be repeated, whichever is first."""
        deadline_ns = now_ns + self.watchdog_ns
        for drone in self._drones:
            if drone.stage is Stage.CUT and drone.link.commands.urgent_ns is not None:
                deadline_ns = min(deadline_ns, drone.link.commands.urgent_ns)
        return deadline_ns

    def _reinitialise(self, now_ns: int) -> None:
        """Reinitialise the control at the positions of drones just taken over, until they follow it."""
        if self._reinitialise_at_ns is None or now_ns < self._reinitialise_at_ns:
            return
        self._reinitialise_at_ns = None
        if self.phase is Phase.HOLD and any(drone.awaited(now_ns) for drone in self._drones):
            self._stack, self._reinitialise_at_ns = self._fresh_stack(), now_ns + REINITIALISE_NS

    def booted_ns(self, sysid: int) -> int | None:
        """When that drone's autopilot booted, on our clock; None where that is not known."""
        link = self._links.get(sysid)
        return None if link is None else link.booted_ns

    def state(self, now_ns: int) -> GroundState:
        """Everything an operator may want to see, but the host's part; reading it changes nothing."""
        facts = self._facts(now_ns)
        about = About(
            t_s=(now_ns - self._t0_ns) * 1e-9,
            session=self._session,
            host=self._host,
            counters=self._counters(),
            rejected={b: rejection_text(c) for b, c in zip(self._bodies, self._rejected.tolist(), strict=True) if c},
            allowed=allowed(self._situation(facts, self._flight.excluded, now_ns)),
        )
        return ground_state(self._flight, self._drones, facts, self._stages, self._config, about, now_ns)

    def _counters(self) -> Counters:
        links, frames = self._links.values(), self._lateness
        return Counters(
            frames=frames.frames,
            missed_frames=frames.missed_frames,
            late_share=round(frames.share, 4),
            stale_frames=self._stale_frames,
            rejected_frames=self._rejected_frames.count,
            bad_bytes=sum(link.codec.bad_bytes for link in links),
            bad_packets=sum(link.codec.bad_packets for link in links),
            lost_packets=sum(link.sequence.lost for link in links),
            superseded_packets=sum(link.sequence.superseded for link in links),
            stray_datagrams=self._strays,
        )

    def _receive_frame(self, frame: LabFrame, now_ns: int) -> None:
        if frame.bodies != self._bodies:
            self._rejected_frames.note("mocap", "frame of other bodies than the lab's", now_ns)
            return
        if frame.t_capture_ns <= self._newest_capture_ns:
            self._stale_frames += 1
            return
        self._newest_capture_ns = frame.t_capture_ns
        self._lateness.note(frame.seq, now_ns, overtaken=self._frame is not None)
        self._frame, self._due = frame, True
        self._rejected = frame.rejected

    def _control(self, frame: LabFrame, plan: Plan, now_ns: int) -> Stages:
        flies = np.array([drone.floor.lifted and not drone.floor.touched for drone in self._drones])
        force_meas, bias = measured_specific_forces(self._drones, frame), self._gatherer.level_bias_rad()
        hover_norm = self._gatherer.hover_thrusts_norm()
        stages = self._stack.step(now_ns, frame, plan, hover_norm, force_meas, bias, flies)
        self._law_failures = self._stack.law_failures()
        self._flight.events += [
            Event(Severity.ERROR, "control", failure.text, code=EventCode.LAW_FAILED, subject=failure.body)
            for failure in self._law_failures
        ]
        state, target = stages.state, stages.target
        # The limits may have put new arrays in the target; in one memory layout the kernel is compiled once.
        numbers = (target.q_lab_from_flu, target.rate_flu_rad_s, target.thrust_norm)
        if not all_finite(state.pos_lab_m, state.vel_lab_m_s, *map(np.ascontiguousarray, numbers)):
            raise BrokenInvariantError(f"frame {frame.seq}: the control's estimate or target is not finite")
        self._stages = stages
        return stages

    def _answer(self, request: OperatorRequest, now_ns: int) -> list[OperatorReply]:
        """Judge a request and apply it; `arm` is answered when every drone has armed, or has not."""
        excluded, reasons = formation_change.participation(request, self._flight)
        now = self._situation(self._facts(now_ns), excluded, now_ns)
        if request.verb is Verb.REPLACE:
            reasons = spare.reject_reasons(request, now, self._links)
        judged = Judged(out_of_turn(request.verb, self.phase) or reasons or reject_reasons(request.verb, now))
        if not judged.reasons:
            judged = formation_change.judge(request, self._flight, now.facts, self._stages, now_ns)
        if judged.reasons:
            return self._reject(request.id, request.verb, judged.reasons)
        if request.verb is Verb.REPLACE:
            self._listen_for_spare(request, now_ns)
            return []
        self._flight.exclude(excluded, now_ns)
        judged.apply()
        self._execute(request, now_ns)
        if request.verb is Verb.ARM:
            self._arming_request = request.id
            return []
        return [OperatorReply(request.id, True, done_text(self._flight))]

    def _reject(self, request: int, verb: Verb, reasons: tuple[Reject, ...]) -> list[OperatorReply]:
        text = "; ".join(reject.text for reject in reasons)
        self._flight.events.append(
            Event(
                Severity.NOTICE,  # the asker has the reply; nobody else has to act
                "operator",
                f"{verb} refused: {text}",
                code=EventCode.REQUEST_REJECTED,
                subject=verb,
            )
        )
        return [OperatorReply(request, False, text, tuple(reject.reason.code for reject in reasons))]

    def _listen_for_spare(self, request: OperatorRequest, now_ns: int) -> None:
        body, sysid = spare.asked_of(request)
        drone = next(drone for drone in self._drones if drone.link.name == body)
        link = self._links[sysid] = self._link(drone.index, sysid)
        for unmet in self._unmet:
            if unmet.sysid == sysid:
                link.boot_parameters.note_unmet(unmet.parameter, unmet.t_ns)
        self._spare = Spare(request.id, drone, link, now_ns)

    def _answer_spare(self, now_ns: int) -> list[OperatorReply]:
        """Have a spare take its place once it is heard, or refuse it."""
        found, flight = self._spare, self._flight
        if found is None or not (found.is_due(now_ns) or out_of_turn(Verb.REPLACE, self.phase)):
            return []
        self._spare = None
        now = self._situation(self._facts(now_ns), flight.excluded, now_ns)
        if reasons := out_of_turn(Verb.REPLACE, self.phase) or found.reject_reasons(now):
            del self._links[found.link.sysid]
            return self._reject(found.request, Verb.REPLACE, reasons)
        del self._links[found.drone.link.sysid]
        flight.exchange(found.drone, found.link, now_ns)
        # Nothing is kept that was learnt of the drone before: its targets, its attitude's errors, its estimates.
        self._packets = Packets(self._drones, self._session, now_ns)
        self._gatherer = FactGatherer(self._config, self._drones)
        self._stack = self._fresh_stack()
        return [OperatorReply(found.request, True, f"{found.words}; {done_text(flight)}")]

    def _situation(self, facts: Facts, excluded: Collection[str], now_ns: int) -> Situation:
        return Situation(self._config, self._drones, self._flight, self._host, self._without, facts, now_ns, excluded)

    def _execute(self, request: OperatorRequest, now_ns: int) -> None:
        """Change the phase as a request asks for that nothing stands against; a landing of one drone changes none."""
        verb = request.verb
        if verb is Verb.ACKNOWLEDGE:
            self._flight.events.append(ACKNOWLEDGED)
        if verb in CHANGES_NO_PHASE or (verb is Verb.LAND and request.argument):
            return
        if verb is Verb.TAKE_CONTROL and (down := takeover_text(self._drones)):
            self._flight.pull(Trigger.LAND, Cause.LANDS_ITSELF, down, now_ns)
            return
        self._flight.pull(Trigger(verb.value), Cause.OPERATOR, f"operator: {verb}", now_ns)
        if verb is Verb.ARM and self._flight.excluded:
            self._stack = self._fresh_stack()  # who was left out and is out of sight is not kept clear of
        if verb is Verb.TAKE_CONTROL:
            self._stack, self._reinitialise_at_ns = self._fresh_stack(), now_ns + REINITIALISE_NS

    def _answer_arming(self, now_ns: int) -> list[OperatorReply]:
        request, flight = self._arming_request, self._flight
        if request is None or (flight.phase is Phase.ARMED and not flight.armed):
            return []
        self._arming_request = None
        if flight.phase is Phase.ARMED:
            return [OperatorReply(request, True, armed_text(flight, now_ns))]
        return [OperatorReply(request, False, flight.cause, (flight.cause_code,))]

    def _facts(self, now_ns: int) -> Facts:
        return self._gatherer.gather(self._stages, self._lateness.share, now_ns)

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
        if self._rejected_frames.has_pending:
            events += self._rejected_frames.due(self._tick_ns)
        for drone in self._drones:
            reports = drone.link.reports
            if reports.events or reports.rejections.has_pending or not drone.checked:
                events += self._pop_events(drone)
        return (*records, *((topics.EVENT, event) for event in events))

    def _pop_events(self, drone: Drone) -> list[Event]:
        """The drone's events since the last tick; once its parameters are read, also warnings about them."""
        link = drone.link
        events = link.reports.pop(self._tick_ns)
        if not drone.checked and link.model is not None and not link.parameters.reading:
            drone.checked = True
            events += [
                Event(Severity.WARNING, link.name, text, code=EventCode.PARAMETER, subject=name)
                for name, text in parameter_warnings(link)
            ]
        return events


def own_laws(config: LabConfig, guard: LawGuard = unlimited) -> OwnLaws | None:
    """The laws that the lab's followers fly by in formation; None where it is ours. ValueError: not installed here."""
    law = config.control_law

    def guarded(now_ns: int, call: Callable[[], Answer]) -> Answer:
        return printing_to_stderr(lambda: guard(now_ns, call))

    return None if law is None else OwnLaws(law_of(law.name, law.options), law.name, config, guarded)
