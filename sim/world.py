"""One simulated flight: every core joined in memory, advanced from event to event. No clock, no process, no file.

It is the daemons' pump with simulated time: the same cores, the same bytes, the same records in the same order; and it
is where a scenario's faults act.
"""

from collections.abc import Sequence

from drone_agent.simulation.physics import OWN, Physics
from formation.control.presets import Preset
from formation.messages import Datagram, Event, HostReport, LabFrame, OperatorRequest, Phase, RawFrame, Truth, Verb
from formation.topics import MOCAP_EVENT, TRUTH
from gcs.mocap.core import MocapCore
from gcs.mocap.gate.armed import motors_on
from gcs.recording import Input, Record
from sim.cameras.emulator import MocapEmulator
from sim.faults import vehicle
from sim.faults.fault import GROUND_RECEIVER, Family, Fault, Site
from sim.faults.onsets import Onsets
from sim.faults.poses import CameraFaults, Thinning, late_ns
from sim.faults.queue import DueQueue
from sim.ground_host import TOLD_AFTER_NS, GroundHost
from sim.life import Waiting
from sim.monitors import WITHOUT_NONE, Without
from sim.scenario import Scenario, agent_configs, leader_seconds, recorded_leader
from sim.script import Glance, Operator
from sim.seat import Sample, Seat

T0_NS = 1_000_000_000
LOOK_NS = 100_000_000
"""How often the operator looks at the ground's state: as often as a daemon publishes it."""


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
        """When a second ground was asked for an emergency stop, which no record tells of."""
        self._lab, self._without, self._gains = scenario.lab, without, gains
        self._record = record
        self._emulator = MocapEmulator(scenario.mocap, scenario.lab, leader, seed, T0_NS)
        self._mocaps = [MocapCore(scenario.lab, without=without.mocap)]
        self._mocap_input = Waiting[RawFrame]()
        self._late_raw = DueQueue[RawFrame]()
        self._late_frames = DueQueue[tuple[str, LabFrame]]()
        self._grounds = [GroundHost(scenario.lab, 0, T0_NS, record, without, gains)]
        self._epochs = 1
        self._told = DueQueue[tuple[GroundHost, Verb]]()
        self.seats = {
            c.sysid: Seat(c, scenario, seed, T0_NS, without, physics) for c in agent_configs(scenario, leader)
        }
        self._body = {v.sysid: v.body for v in scenario.lab.vehicles if v.sysid is not None}
        self._seat_of = {self._body[sysid]: seat for sysid, seat in self.seats.items()}
        self._camera_faults = CameraFaults(scenario.lab, seed)
        self._thinning = {name: Thinning() for name in (GROUND_RECEIVER, *self._body.values())}
        self._look_ns = T0_NS
        self.faults = Onsets(scenario.faults)
        self.faults.enter(Phase.GROUND, T0_NS)

    @property
    def log_is_ill(self) -> bool:
        """Whether the first ground is there, and its log cannot be written."""
        return self._grounds[0].answers and bool(self.faults.active(Site.HOST))

    def inject(self, faults: Sequence[Fault]) -> None:
        """Let these faults happen from now on instead of the scenario's; none of them may have begun yet."""
        self.faults = Onsets(faults, self.faults.entered)

    def kill_ground(self) -> None:
        """From now on the ground hears nothing and says nothing; mocap and agents go on."""
        self._grounds[0].kill()

    def truths(self) -> dict[int, Truth]:
        """The true state of every drone now, by sysid."""
        return {sysid: seat.agent.truth(self.now_ns) for sysid, seat in self.seats.items()}

    def samples(self) -> list[Sample]:
        """What is true of every drone, to the last millisecond."""
        return [seat.sample() for seat in self.seats.values()]

    def ask(self, verb: Verb, argument: str = "") -> None:
        """The operator asks the first ground, whatever the script; it is lost on one that is gone."""
        self._grounds[0].ask(OperatorRequest(0, verb, argument), self.now_ns)

    def take_events(self) -> list[Event]:
        """What drones and bridges have told since the last time."""
        told = [event for seat in self.seats.values() for event in seat.events]
        for seat in self.seats.values():
            seat.events.clear()
        return told

    def step(self) -> None:
        """Move on to the next event and do all that is due then, in a fixed order."""
        now_ns = self.now_ns = self._next_event_ns()
        emulator = self._emulator
        if self.faults.next_due_ns <= now_ns:
            self._change_faults()
        if emulator.next_exposure_ns <= now_ns:
            self._expose()
        if emulator.next_frame_ns <= now_ns or self._late_raw.next_due_ns <= now_ns:
            self._show_frames()
        if self._late_frames.next_due_ns <= now_ns:
            for receiver, frame in self._late_frames.pop_due(now_ns):
                self._deliver(receiver, frame)
        for seat in self.seats.values():
            if seat.due_ns <= now_ns:
                self._serve(seat)
        if self._look_ns <= now_ns:
            self._operator_looks()
        for ground, verb in self._told.pop_due(now_ns):
            ground.ask(OperatorRequest(0, verb), now_ns)
            if verb is Verb.STOP and ground in self._grounds[1:] and ground.answers:
                self.stops_beside_ns.append(now_ns)
        for ground in self._grounds:
            if ground.due_ns <= now_ns:
                self._ground_ticks(ground)

    def _next_event_ns(self) -> int:
        emulator = self._emulator
        due_ns = min(
            emulator.next_exposure_ns, emulator.next_frame_ns, self._look_ns, self.faults.next_due_ns,
            self._late_raw.next_due_ns, self._late_frames.next_due_ns, self._told.next_due_ns,
            *[ground.due_ns for ground in self._grounds],
            *[seat.due_ns for seat in self.seats.values()],
        )  # fmt: skip
        return max(due_ns, self.now_ns)

    def _expose(self) -> None:
        truths, self.exposed_ns = self.truths(), self.now_ns
        for truth in truths.values():
            self._record(TRUTH, truth, self.now_ns)
        self._emulator.expose(truths)

    def _show_frames(self) -> None:
        """Raw frames arrive at the mocap; its frames go to the ground and to every drone's own pose feed."""
        now_ns = self.now_ns
        for raw in self._emulator.pop_due(now_ns):
            altered, delay_ns = self._camera_faults.alter(raw, self.faults.active(Site.CAMERAS), now_ns)
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
            met = [fault for _, fault, _ in self.faults.active(Site.BUS)]
            for receiver, thinning in self._thinning.items():
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
            seat = self._seat_of[receiver]
            seat.see(frame, self.now_ns)
            seat.look_ahead()

    def _serve(self, seat: Seat) -> None:
        """What arrives at the drone, what it does of itself, what arrives from it."""
        now_ns = self.now_ns
        said: list[Datagram] = []
        for sent in seat.down.pop_due(now_ns):
            said += seat.hear(sent, now_ns)
        said += seat.say(now_ns)
        if said:
            faults = self._on_link(seat, "up")
            for datagram in said:
                seat.up.push(now_ns, datagram, faults)
        for sent in seat.up.pop_due(now_ns):
            self._grounds_receive(sent.datagram)
        seat.look_ahead()

    def _operator_looks(self) -> None:
        now_ns, ground = self.now_ns, self._grounds[0]
        self._look_ns = now_ns + LOOK_NS
        self._hosts_report()
        if not ground.answers:
            return
        state = ground.status(now_ns)
        for mocap in self._mocaps:
            mocap.note_motors(motors_on(state))
        glance = Glance.at(state)
        if glance.formed:
            self._emulator.start(now_ns)
        self.operator.observe(glance, now_ns)
        request = self.operator.next_request(now_ns)
        if request is not None:
            ground.receive(request, now_ns)

    def _hosts_report(self) -> None:
        """As the daemons' hosts do: who else is a ground on the lab's bus, and how the log fares."""
        trouble = "; ".join(fault.text() for _, fault, _ in self.faults.active(Site.HOST))
        for ground in self._grounds:
            others = tuple(other.name for other in self._grounds if other is not ground and other.answers)
            ground.report(HostReport(others, trouble), self.now_ns)

    def _grounds_receive(self, message: Input) -> None:
        for ground in self._grounds:
            ground.receive(message, self.now_ns)

    def _ground_ticks(self, ground: GroundHost) -> None:
        now_ns = self.now_ns
        datagrams, replies = ground.tick(now_ns)
        for datagram in datagrams:
            seat = self.seats[datagram.sysid]
            seat.down.push(now_ns, datagram, self._on_link(seat, "down"))
            seat.due_ns = min(seat.due_ns, seat.down.next_due_ns)
        for reply in replies:
            self.operator.receive(reply, now_ns)
        if ground is self._grounds[0] and ground.phase is not self.phase:
            self.phase = ground.phase
            self.faults.enter(self.phase, now_ns)

    # Faults

    def _on_link(self, seat: Seat, way: str) -> list[tuple[Fault, int]]:
        body = self._body[seat.sysid]
        return [
            (fault, onset_ns)
            for _, fault, onset_ns in self.faults.active(Site.LINK)
            if fault.hits(body) and fault.direction in ("both", way)
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
                    for seat in self._hit(fault):
                        (seat.begin if begins else seat.end)(fault, self.now_ns)
                        seat.look_ahead()

    def _hit(self, fault: Fault) -> Sequence[Seat]:
        return [seat for seat in self.seats.values() if fault.hits(self._body[seat.sysid])]

    def _change_vehicle(self, fault: Fault, begins: bool) -> None:
        if fault.family is Family.REQUEST:
            if begins and fault.verb is not None:
                self.ask(fault.verb, fault.argument)
            return
        for seat in self._hit(fault):
            (vehicle.begin if begins else vehicle.end)(fault, seat.agent, self.now_ns)
            seat.look_ahead()

    def _change_ground(self, fault: Fault, begins: bool) -> None:
        first, now_ns = self._grounds[0], self.now_ns
        match fault.family, begins:
            case ((Family.KILL | Family.RESTART), True):
                first.kill()
            case Family.STALL, True:
                first.stall()
            case Family.STALL, False:
                first.wake(now_ns)
            case Family.RESTART, False:
                self._grounds[0] = self._new_ground(fault)
            case Family.TWIN, True:
                self._grounds.append(self._new_ground(fault).second())
            case Family.TWIN, False:
                del self._grounds[1:]

    def _new_ground(self, fault: Fault) -> GroundHost:
        ground = GroundHost(self._lab, self._epochs, self.now_ns, self._record, self._without, self._gains)
        self._epochs += 1
        if fault.verb is not None:
            self._told.push(self.now_ns + TOLD_AFTER_NS, (ground, fault.verb))
        return ground

    def _change_mocap(self, fault: Fault, begins: bool) -> None:
        match fault.family, begins:
            case ((Family.KILL | Family.RESTART), True):
                self._mocap_input.kill()
            case Family.STALL, True:
                self._mocap_input.stall()
            case Family.STALL, False:
                for raw in self._mocap_input.wake():
                    self._publish(raw)
            case Family.RESTART, False:
                self._mocaps[0] = MocapCore(self._lab, without=self._without.mocap)
                self._mocap_input.wake()
            case Family.TWIN, True:
                self._mocaps.append(MocapCore(self._lab, without=self._without.mocap))
            case Family.TWIN, False:
                del self._mocaps[1:]
