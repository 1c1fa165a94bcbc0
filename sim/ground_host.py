"""A ground in a lockstep flight: its core, and whether it lives."""

from collections.abc import Callable
from dataclasses import replace

from formation.config import LabConfig
from formation.control.presets import Preset
from formation.messages import Datagram, Event, EventCode, HostReport, OperatorReply, OperatorRequest, Phase, Severity
from formation.topics import EVENT
from gcs.core import BrokenInvariantError, GcsCore
from gcs.recording import Input, Record, Recorder
from gcs.warm_up import LAW_S
from sim.monitors import Without
from sim.process_input import ProcessInput
from wire.ground_state import GroundState
from wire.mavlink.framing import frame_count
from wire.process.deadline import Deadline
from wire.transport.link import PAUSE_S, TURN_NS, Backlog, LinkCounters
from wire.transport.memory_bus import NOTHING_DUE_NS

PAUSE_NS = round(PAUSE_S * 1e9)


class VirtualIntake:
    """Enqueue what arrives in `backlog`, then `turn`, again at `due_ns`.

    Each packet costs the ground some work, done as simulated time passes. A turn ends when TURN_NS of it are to be
    done; what waits then has its turn when that is done and everybody else had theirs, and becomes newer meanwhile.
    """

    def __init__(self, sysid: int, work_ns: int, counters: LinkCounters) -> None:
        """work_ns: that one packet costs."""
        self.backlog = Backlog(sysid, counters)
        """What has arrived."""
        self._work_ns = work_ns
        self._idle_ns = 0
        """When all work is done."""
        self.due_ns = NOTHING_DUE_NS
        """When the next turn of what waits is due."""

    def turn(self, deliver: Callable[[Datagram, int], None], now_ns: int) -> None:
        """Deliver what is due now; nothing while an earlier turn's work is not done."""
        if self.due_ns > now_ns and self.due_ns != NOTHING_DUE_NS:
            return
        self._idle_ns = max(self._idle_ns, now_ns)
        self.due_ns = NOTHING_DUE_NS
        for datagram in self.backlog.dequeue():
            deliver(datagram, now_ns)
            self._idle_ns += self._work_ns * max(frame_count(datagram.data), 1) if self._work_ns else 0
            if self._idle_ns - now_ns >= TURN_NS:
                self.due_ns = self._idle_ns + PAUSE_NS
                break


REQUEST_IDS = 1_000_000
"""From here on count the requests that faults make; the operator's own begin at 1."""
REQUEST_DELAY_NS = 1_500_000_000


class GroundHost:
    """The ground of that session; of a second one beside the first, only its events are recorded."""

    def __init__(
        self,
        lab: LabConfig,
        session: int,
        now_ns: int,
        record: Record,
        without: Without,
        gains: Preset | None = None,
        ingest_s: float = 0.0,
        second: bool = False,
    ) -> None:
        """ingest_s: of work that one packet of a drone costs it. second: beside a first one."""
        self._record = record
        self._recorder = Recorder(record)
        self._second = second
        self._input = ProcessInput[Input]()
        self.name = f"ground-{session}"
        # Of the host's time: simulated time stands still meanwhile, so it only ends what never ends.
        self._core = GcsCore(lab, now_ns, session, without.ground, gains, Deadline(LAW_S, LAW_S))
        self._report = HostReport()
        self._intakes: dict[int, VirtualIntake] = {}
        self.counters = LinkCounters()
        self._ingest_due_ns = NOTHING_DUE_NS
        self._ingest_ns = round(ingest_s * 1e9)
        self.due_ns = self._core.next_deadline_ns()
        """When `tick` is due, or telemetry that waits is to be taken in."""
        self._requests = REQUEST_IDS * (session + 1)

    @property
    def is_running(self) -> bool:
        """Whether it can be asked."""
        return self._input.runs

    @property
    def phase(self) -> Phase:
        """Its phase."""
        return self._core.phase

    def state(self, now_ns: int) -> GroundState:
        """What it publishes."""
        return self._core.state(now_ns)

    def receive(self, message: Input, now_ns: int) -> None:
        """Something arrives. What drones say passes the same intake as in a daemon."""
        if isinstance(message, Datagram):
            self._receive_datagram(message, now_ns)
        elif self._input.admits(message):
            self._pass_to_core(message, now_ns)
        self._update_due()

    def _update_due(self) -> None:
        """After every change of the core or its input."""
        runs = self._input.runs
        self.due_ns = min(self._core.next_deadline_ns(), self._ingest_due_ns) if runs else NOTHING_DUE_NS

    def _receive_datagram(self, datagram: Datagram, now_ns: int) -> None:
        """What comes to a ground that is stalled waits in its sockets; to one that is dead, it is lost."""
        if not self._input.lives:
            return
        sysid = datagram.sysid
        if sysid not in self._intakes:
            self._intakes[sysid] = VirtualIntake(sysid, self._ingest_ns, self.counters)
        intake = self._intakes[sysid]
        intake.backlog.enqueue(datagram.data, datagram.superseded)
        if self._input.runs:
            self._ingest(intake, now_ns)

    def _ingest(self, intake: VirtualIntake, now_ns: int) -> None:
        intake.turn(self._pass_to_core, now_ns)
        if intake.due_ns != NOTHING_DUE_NS or self._ingest_due_ns != NOTHING_DUE_NS:
            self._ingest_due_ns = min([other.due_ns for other in self._intakes.values()])

    def _pass_to_core(self, message: Input, now_ns: int) -> None:
        if not self._second:
            self._recorder.input(message, now_ns)
        self._core.receive(message, now_ns)

    def report(self, report: HostReport, now_ns: int) -> None:
        """A changed report of the host arrives."""
        if report != self._report and self.is_running:
            self._report = report
            self.receive(report, now_ns)

    def ask(self, request: OperatorRequest, now_ns: int) -> None:
        """A request that a fault makes: numbered here."""
        self._requests += 1
        self.receive(replace(request, id=self._requests), now_ns)

    def tick(self, now_ns: int) -> tuple[tuple[Datagram, ...], tuple[OperatorReply, ...]]:
        """What it sends and answers now; a ground that finds itself wrong ends."""
        sent = self._tick(now_ns)
        self._update_due()
        return sent

    def _tick(self, now_ns: int) -> tuple[tuple[Datagram, ...], tuple[OperatorReply, ...]]:
        for intake in self._intakes.values() if self._ingest_due_ns <= now_ns else ():
            self._ingest(intake, now_ns)
        if self._core.next_deadline_ns() > now_ns:
            return (), ()
        try:
            outgoing = self._core.tick(now_ns)
        except BrokenInvariantError as error:
            self.kill()
            self._record(EVENT, Event(Severity.CRITICAL, "ground", str(error), code=EventCode.GROUND_FAILED), now_ns)
            return (), ()
        if not self._second:
            self._recorder.tick(outgoing, now_ns)
            return outgoing.datagrams, outgoing.replies
        for topic, message in outgoing.records:
            if topic is EVENT and isinstance(message, Event):
                self._record(EVENT, replace(message, source=f"second ground, {message.source}"), now_ns)
        return outgoing.datagrams, ()

    def stall(self) -> None:
        """It stops where it is."""
        self._input.stall()
        self._update_due()

    def kill(self) -> None:
        """From now on it hears nothing and says nothing."""
        self._input.kill()
        self._intakes.clear()
        self._ingest_due_ns = NOTHING_DUE_NS
        self._update_due()

    def resume(self, now_ns: int) -> None:
        """It goes on after a stall, with what has come meanwhile."""
        for message in self._input.resume():
            self._pass_to_core(message, now_ns)
        for intake in self._intakes.values():
            self._ingest(intake, now_ns)
        self._update_due()
