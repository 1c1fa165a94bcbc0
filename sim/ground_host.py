"""A ground in a lockstep flight: its core, and whether it lives."""

from dataclasses import replace

from formation.config import LabConfig
from formation.control.presets import Preset
from formation.messages import Datagram, Event, HostReport, OperatorReply, OperatorRequest, Phase, Severity
from formation.topics import EVENT
from gcs.core import BrokenInvariantError, GcsCore
from gcs.recording import Input, Record, Recorder
from sim.life import Waiting
from sim.monitors import Without
from wire.process.deadline import Deadline
from wire.transport.memory_bus import NOTHING_DUE_NS

REQUEST_IDS = 1_000_000
"""From here on count the requests that faults make; the operator's own begin at 1."""
TOLD_AFTER_NS = 1_500_000_000
LAW_S = 5.0
"""For the lab's own law, of the host's time: simulated time stands still meanwhile, so it only ends what never ends."""


class GroundHost:
    """The ground of that epoch; of a second one beside the first, only what it tells is recorded."""

    def __init__(
        self,
        lab: LabConfig,
        epoch: int,
        now_ns: int,
        record: Record,
        without: Without,
        gains: Preset | None = None,
    ) -> None:
        self._record = record
        self._recorder = Recorder(record)
        self._second = False
        self._input = Waiting[Input]()
        self.name = f"ground-{epoch}"
        self._core = GcsCore(lab, now_ns, epoch, without.ground, gains, Deadline(LAW_S, LAW_S))
        self._report = HostReport()
        self._requests = REQUEST_IDS * (epoch + 1)

    def second(self) -> "GroundHost":
        """The same as one beside the first."""
        self._second = True
        return self

    @property
    def answers(self) -> bool:
        """Whether it can be asked."""
        return self._input.runs

    @property
    def due_ns(self) -> int:
        """When `tick` is due."""
        return self._core.next_deadline_ns() if self._input.runs else NOTHING_DUE_NS

    @property
    def phase(self) -> Phase:
        """Its phase."""
        return self._core.phase

    def status(self, now_ns: int) -> str:
        """What it publishes."""
        return self._core.status(now_ns)

    def receive(self, message: Input, now_ns: int) -> None:
        """Something arrives."""
        if not self._input.admits(message):
            return
        if not self._second:
            self._recorder.input(message, now_ns)
        self._core.receive(message, now_ns)

    def report(self, report: HostReport, now_ns: int) -> None:
        """What its host tells it of itself, where that is new."""
        if report != self._report and self.answers:
            self._report = report
            self.receive(report, now_ns)

    def ask(self, request: OperatorRequest, now_ns: int) -> None:
        """A request that a fault makes: numbered here."""
        self._requests += 1
        self.receive(replace(request, id=self._requests), now_ns)

    def tick(self, now_ns: int) -> tuple[tuple[Datagram, ...], tuple[OperatorReply, ...]]:
        """What it sends and answers now; a ground that finds itself wrong ends."""
        try:
            outgoing = self._core.tick(now_ns)
        except BrokenInvariantError as error:
            self.kill()
            self._record(EVENT, Event(Severity.CRITICAL, "ground", str(error)), now_ns)
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

    def kill(self) -> None:
        """From now on it hears nothing and says nothing."""
        self._input.kill()

    def wake(self, now_ns: int) -> None:
        """It goes on after a stall, with what has come meanwhile."""
        for message in self._input.wake():
            self.receive(message, now_ns)
