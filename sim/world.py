"""One simulated flight: every core joined in memory, advanced from event to event. No clock, no process, no file.

It is the daemons' pump with simulated time: the same cores, the same bytes, the same records in the same order; and it
is where a scenario's faults act.
"""

from collections.abc import Sequence
from heapq import heappop, heappush
from itertools import count

from drone_agent.simulation.airframe import share_air
from drone_agent.simulation.attitude_loop import OWN, Physics
from formation.control.presets import Preset
from formation.messages import Event, HostReport, LabFrame, OperatorRequest, Phase, RawFrame, Truth, Verb
from formation.topics import INNOVATION, MOCAP_EVENT, TRUTH
from gcs.recording import Input, Record
from mocap.core import MocapCore
from sim.cameras.emulator import MocapEmulator
from sim.drone_node import DroneNode, Sample
from sim.faults import vehicle
from sim.faults.channel import Sent
from sim.faults.fault import GROUND_RECEIVER, Family, Fault, Site
from sim.faults.onsets import Onsets
from sim.faults.poses import CameraFaults, Thinning, late_ns
from sim.faults.queue import DueQueue
from sim.ground_host import REQUEST_DELAY_NS, GroundHost
from sim.monitors import WITHOUT_NONE, Without
from sim.process_input import ProcessInput
from sim.scenario import Scenario, agent_configs, leader_seconds, recorded_leader
from sim.script import Operator, OperatorView

T0_NS = 1_000_000_000
OPERATOR_PERIOD_NS = 100_000_000
"""Period at which the operator reads the ground's state: that of a daemon's publishing."""
_TURNS = 3
_DOWN, _TICK, _UP = range(_TURNS)
"""What is due at one time, drone after drone: what arrives at it, its tick, what arrives from it."""


class World:
    """The cores, the links between them and the operator; `step` moves on to the next event."""

    def __init__(
        self,
        scenario: Scenario,
        seed: int,
        record: Record,
        without: Without = WITHOUT_NONE,
        gains: Preset | None = None,
        physics: Physics = OWN,
    ) -> None:
        """without: monitors that are switched off; gains: those of the ground, in the place of the lab's preset.

        physics: what integrates the vehicles.
        """
        leader = recorded_leader(scenario)
        self.now_ns = T0_NS
        self.operator = Operator(scenario.script, leader_seconds(scenario, leader))
        self.phase = Phase.GROUND
        self.exposed_ns = 0
        """When the cameras last took a frame."""
        self.stops_beside_ns: list[int] = []
        """When a second ground was asked for an emergency stop, which is in no record."""
        self._lab, self._without, self._gains = scenario.lab, without, gains
        self._ingest_s = scenario.link.ingest_s
        self._record = record
        self._emulator = MocapEmulator(scenario.mocap, scenario.lab, leader, seed, T0_NS)
        self._mocaps = [MocapCore(scenario.lab, without=without.mocap)]
        self._mocap_input = ProcessInput[RawFrame]()
        self._late_raw = DueQueue[RawFrame]()
        self._late_frames = DueQueue[tuple[str, LabFrame]]()
        self._grounds = [GroundHost(scenario.lab, 0, T0_NS, record, without, gains, scenario.link.ingest_s)]
        self._sessions = 1
        self._late_requests = DueQueue[tuple[GroundHost, Verb]]()
        self.nodes = {
            c.sysid: DroneNode(c, scenario, seed, T0_NS, without, physics) for c in agent_configs(scenario, leader)
        }
        self._in_order = list(self.nodes.values())
        self._airframes = [node.autopilot.airframe for node in self._in_order]
        self._count = count()
        self._drones_due: list[tuple[int, int, int, Sent | None]] = []
        """A heap: when, whose of `_TURNS` turns, a number that keeps the order, and what arrives then; None: a tick."""
        for row, node in enumerate(self._in_order):
            node.row = row
            self._enter(node)
        self._body = {v.sysid: v.body for v in scenario.lab.vehicles if v.sysid is not None}
        self._node_of = {self._body[sysid]: node for sysid, node in self.nodes.items()}
        self._camera_faults = CameraFaults(scenario.lab, seed)
        self._thinning = {name: Thinning() for name in (GROUND_RECEIVER, *self._body.values())}
        self._operator_due_ns = T0_NS
        self.faults = Onsets(scenario.faults)
        self.faults.enter(Phase.GROUND, T0_NS)

    @property
    def log_is_ill(self) -> bool:
        """Whether the first ground is there, and its log cannot be written."""
        return self._grounds[0].is_running and bool(self.faults.active[Site.HOST])

    def inject(self, faults: Sequence[Fault]) -> None:
        """Let these faults happen from now on instead of the scenario's; none of them may have begun yet."""
        self.faults = Onsets(faults, self.faults.entered)

    def truths(self) -> dict[int, Truth]:
        """The true state of every drone now, by sysid."""
        return {sysid: node.autopilot.truth(self.now_ns) for sysid, node in self.nodes.items()}

    def samples(self) -> list[Sample]:
        """The true state of every drone, at the last millisecond."""
        return [node.sample() for node in self.nodes.values()]

    def ask(self, verb: Verb, argument: str = "") -> None:
        """The operator asks the first ground, whatever the script; it is lost on one that is gone."""
        self._grounds[0].ask(OperatorRequest(0, verb, argument), self.now_ns)

    def pop_events(self) -> list[Event]:
        """The events of drones and bridges since the last call."""
        events = [event for node in self.nodes.values() for event in node.events]
        for node in self.nodes.values():
            node.events.clear()
        return events

    def step(self) -> None:
        """Move on to the next event and do all that is due then, in a fixed order."""
        now_ns = self.now_ns = self._next_event_ns()
        emulator = self._emulator
        if self.faults.next_due_ns <= now_ns:
            self._change_faults()
        if emulator.next_exposure_ns <= now_ns:
            self._expose()
        if emulator.cable.next_due_ns <= now_ns or self._late_raw.next_due_ns <= now_ns:
            self._show_frames()
        if self._late_frames.next_due_ns <= now_ns:
            for receiver, frame in self._late_frames.pop_due(now_ns):
                self._deliver(receiver, frame)
        while self._drones_due and self._drones_due[0][0] <= now_ns:
            self._serve(*heappop(self._drones_due))
        if self._operator_due_ns <= now_ns:
            self._tick_operator()
        if self._late_requests.next_due_ns <= now_ns:
            self._ask_late()
        for ground in self._grounds:
            if ground.due_ns <= now_ns:
                self._ground_ticks(ground)

    def _ask_late(self) -> None:
        for ground, verb in self._late_requests.pop_due(self.now_ns):
            ground.ask(OperatorRequest(0, verb), self.now_ns)
            if verb is Verb.STOP and ground in self._grounds[1:] and ground.is_running:
                self.stops_beside_ns.append(self.now_ns)

    def _next_event_ns(self) -> int:
        emulator = self._emulator
        due_ns = min(
            emulator.next_exposure_ns, emulator.cable.next_due_ns, self._operator_due_ns, self.faults.next_due_ns,
            self._late_raw.next_due_ns, self._late_frames.next_due_ns, self._late_requests.next_due_ns,
        )  # fmt: skip
        due = self._drones_due
        while due and due[0][3] is None and due[0][0] != self._in_order[due[0][1] // _TURNS].entered_ns:
            heappop(due)  # entered anew since
        if due:
            due_ns = min(due_ns, due[0][0])
        for ground in self._grounds:
            due_ns = min(due_ns, ground.due_ns)
        return max(due_ns, self.now_ns)

    def _expose(self) -> None:
        truths, self.exposed_ns = self.truths(), self.now_ns
        for truth in truths.values():
            self._record(TRUTH, truth, self.now_ns)
        self._emulator.expose(truths)
        share_air(self._airframes)

    def _show_frames(self) -> None:
        """Raw frames arrive at the mocap; its frames go to the ground and to every drone's own pose feed."""
        now_ns = self.now_ns
        for raw in self._emulator.pop_due(now_ns):
            altered, delay_ns = self._camera_faults.alter(raw, self.faults.active[Site.CAMERAS], now_ns)
            self._late_raw.push(now_ns + delay_ns, altered)
        for raw in self._late_raw.pop_due(now_ns):
            if self._mocap_input.admits(raw):
                self._publish(raw)

    def _publish(self, raw: RawFrame) -> None:
        for mocap in self._mocaps:
            frame = mocap.receive(raw, self.now_ns)
            for event in mocap.events(self.now_ns):
                self._record(MOCAP_EVENT, event, self.now_ns)
            if frame is None:
                continue
            met = [fault for _, fault, _ in self.faults.active[Site.BUS]]
            for receiver, thinning in self._thinning.items():
                if not met:
                    self._deliver(receiver, frame)
                    continue
                faults = [fault for fault in met if fault.receiver in (None, receiver)]
                if not thinning.passes(faults):
                    continue
                delay_ns = late_ns(faults)
                if delay_ns:
                    self._late_frames.push(self.now_ns + delay_ns, (receiver, frame))
                else:
                    self._deliver(receiver, frame)

    def _deliver(self, receiver: str, frame: LabFrame) -> None:
        if receiver == GROUND_RECEIVER:
            self._grounds_receive(frame)
        else:
            node = self._node_of[receiver]
            node.receive_frame(frame, self.now_ns)
            self._changed(node)

    def _serve(self, due_ns: int, turn: int, _: int, sent: Sent | None) -> None:
        """A datagram has arrived at a drone, it is to tick, or a datagram of it has arrived at the grounds."""
        node, now_ns = self._in_order[turn // _TURNS], self.now_ns
        if sent is None:
            if due_ns != node.entered_ns:
                return
            node.entered_ns = -1
            datagrams = node.tick(now_ns)
        elif turn % _TURNS == _UP:
            self._grounds_receive(sent.datagram)
            return
        else:
            datagrams = node.receive_datagram(sent, now_ns)
        if node.innovations:
            for innovation in node.innovations:
                self._record(INNOVATION, innovation, now_ns)
            node.innovations.clear()
        if datagrams:
            faults = self._on_link(node, "up") if self.faults.active[Site.LINK] else ()
            for datagram in datagrams:
                self._arrive(node, _UP, node.up.send(now_ns, datagram, faults))
        self._enter(node)

    def _arrive(self, node: DroneNode, turn: int, arriving: list[tuple[int, Sent]]) -> None:
        for due_ns, sent in arriving:
            heappush(self._drones_due, (due_ns, _TURNS * node.row + turn, next(self._count), sent))

    def _enter(self, node: DroneNode) -> None:
        due_ns = max(node.due_ns, self.now_ns)
        if due_ns != node.entered_ns:
            node.entered_ns = due_ns
            heappush(self._drones_due, (due_ns, _TURNS * node.row + _TICK, next(self._count), None))

    def _changed(self, node: DroneNode) -> None:
        """Something was done to the drone from outside."""
        node.due_ns = node.drone.due_ns
        self._enter(node)

    def _tick_operator(self) -> None:
        now_ns, ground = self.now_ns, self._grounds[0]
        self._operator_due_ns = now_ns + OPERATOR_PERIOD_NS
        self._hosts_report()
        if not ground.is_running:
            return
        state = ground.state(now_ns)
        for mocap in self._mocaps:
            mocap.note_motors(state.motors_on)
        view = OperatorView.at(state)
        if view.formed:
            self._emulator.start(now_ns)
        self.operator.observe(view, now_ns)
        request = self.operator.next_request(now_ns)
        if request is not None:
            ground.receive(request, now_ns)

    def _hosts_report(self) -> None:
        """As the daemons' hosts do: who else is a ground on the lab's bus, and how the log fares."""
        trouble = "; ".join(fault.text() for _, fault, _ in self.faults.active[Site.HOST])
        for ground in self._grounds:
            others = tuple(other.name for other in self._grounds if other is not ground and other.is_running)
            ground.report(HostReport(others, trouble), self.now_ns)

    def _grounds_receive(self, message: Input) -> None:
        for ground in self._grounds:
            ground.receive(message, self.now_ns)

    def _ground_ticks(self, ground: GroundHost) -> None:
        now_ns = self.now_ns
        datagrams, replies = ground.tick(now_ns)
        for datagram in datagrams:
            node = self.nodes[datagram.sysid]
            faults = self._on_link(node, "down") if self.faults.active[Site.LINK] else ()
            self._arrive(node, _DOWN, node.down.send(now_ns, datagram, faults))
        for reply in replies:
            self.operator.receive(reply, now_ns)
        if ground is self._grounds[0] and ground.phase is not self.phase:
            self.phase = ground.phase
            self.faults.enter(self.phase, now_ns)

    # Faults

    def _on_link(self, node: DroneNode, direction: str) -> list[tuple[Fault, int]]:
        body = self._body[node.sysid]
        return [
            (fault, onset_ns)
            for _, fault, onset_ns in self.faults.active[Site.LINK]
            if fault.hits(body) and fault.direction in ("both", direction)
        ]

    def _change_faults(self) -> None:
        for fault, begins in self.faults.pop_due(self.now_ns):
            match fault.site:
                case Site.VEHICLE | Site.OPERATOR:
                    self._change_vehicle(fault, begins)
                case Site.CORE if fault.core == "ground":
                    self._change_ground(fault, begins)
                case Site.CORE if fault.core == "mocap":
                    self._change_mocap(fault, begins)
                case Site.CORE:
                    for node in self._hit(fault):
                        (node.begin if begins else node.end)(fault, self.now_ns)
                        self._changed(node)

    def _hit(self, fault: Fault) -> Sequence[DroneNode]:
        return [node for node in self.nodes.values() if fault.hits(self._body[node.sysid])]

    def _change_vehicle(self, fault: Fault, begins: bool) -> None:
        if fault.family is Family.REQUEST:
            if begins and fault.verb is not None:
                self.ask(fault.verb, fault.argument)
            return
        for node in self._hit(fault):
            (vehicle.begin if begins else vehicle.end)(fault, node.autopilot, self.now_ns)
            self._changed(node)

    def _change_ground(self, fault: Fault, begins: bool) -> None:
        first, now_ns = self._grounds[0], self.now_ns
        match fault.family, begins:
            case ((Family.KILL | Family.RESTART), True):
                first.kill()
            case Family.STALL, True:
                first.stall()
            case Family.STALL, False:
                first.resume(now_ns)
            case Family.RESTART, False:
                self._grounds[0] = self._new_ground(fault)
            case Family.TWIN, True:
                self._grounds.append(self._new_ground(fault))
            case Family.TWIN, False:
                del self._grounds[1:]

    def _new_ground(self, fault: Fault) -> GroundHost:
        ground = GroundHost(
            self._lab, self._sessions, self.now_ns, self._record, self._without, self._gains, self._ingest_s,
            second=fault.family is Family.TWIN,
        )  # fmt: skip
        self._sessions += 1
        if fault.verb is not None:
            self._late_requests.push(self.now_ns + REQUEST_DELAY_NS, (ground, fault.verb))
        return ground

    def _change_mocap(self, fault: Fault, begins: bool) -> None:
        match fault.family, begins:
            case ((Family.KILL | Family.RESTART), True):
                self._mocap_input.kill()
            case Family.STALL, True:
                self._mocap_input.stall()
            case Family.STALL, False:
                for raw in self._mocap_input.resume():
                    self._publish(raw)
            case Family.RESTART, False:
                self._mocaps[0] = MocapCore(self._lab, without=self._without.mocap)
                self._mocap_input.resume()
            case Family.TWIN, True:
                self._mocaps.append(MocapCore(self._lab, without=self._without.mocap))
            case Family.TWIN, False:
                del self._mocaps[1:]
