"""A drone whose autopilot is ours: the guard, and that autopilot behind it, joined in memory as by a cable. No sockets.

The guard is the one that stands beside a real autopilot (drone_agent.guard.core); it alone hears ground and mocap.
"""

from typing import Generic, NamedTuple, TypeVar

from drone_agent.config import SimulatedDroneConfig
from drone_agent.core import AgentCore, AutopilotCore
from drone_agent.guard.core import GuardCore
from drone_agent.guard.navigator import Fault
from drone_agent.simulation.attitude_loop import OWN, Physics
from formation.messages import Datagram, Event, Innovation, LabFrame, Truth
from wire.mavlink.framing import Frame


class DroneOutgoing(NamedTuple):
    """What one tick gives: for the ground, and of what guard and autopilot exchanged."""

    datagrams: list[Datagram]
    truth: Truth | None
    events: list[Event]
    innovations: list[Innovation]
    faults: list[Fault]
    to_autopilot: list[Frame]
    unread: list[list[Frame]]
    """Frames of the autopilot while there is no guard."""
    due_ns: int
    """When the next tick is due if nothing arrives."""


Behind = TypeVar("Behind", bound=AutopilotCore)


class Guarded(Generic[Behind]):
    """One drone. Call a `receive` with what arrives and `tick` no later than `due_ns`."""

    def __init__(self, guard: GuardCore, autopilot: Behind) -> None:
        self.guards = [guard]
        """One; in a simulation of faults none, or two that were started by mistake."""
        self.autopilot = autopilot

    def receive(self, datagram: Datagram, now_ns: int) -> None:
        """Receive the ground's datagram. Never raises on what it holds, nor does another `receive`."""
        for guard in self.guards:
            guard.receive_ground(datagram, now_ns)

    def receive_frame(self, frame: LabFrame, now_ns: int) -> None:
        """Receive a mocap frame."""
        for guard in self.guards:
            guard.receive_frame(frame, now_ns)

    def receive_autopilot(self, frames: list[Frame], now_ns: int) -> None:
        """Receive what the autopilot has sent."""
        for guard in self.guards:
            guard.receive_autopilot(frames, now_ns)

    def tick(self, now_ns: int) -> DroneOutgoing:
        """Everything to send now; guard and autopilot exchange theirs, without delay, until neither has more."""
        autopilot, truth, busy = self.autopilot, None, True
        datagrams: list[Datagram] = []
        events: list[Event] = []
        innovations: list[Innovation] = []
        faults: list[Fault] = []
        to_autopilot: list[Frame] = []
        unread: list[list[Frame]] = []
        while busy:
            busy = autopilot.due_ns <= now_ns
            if busy:
                turn = autopilot.turn(now_ns)
                events += turn.events
                truth = truth if turn.truth is None else turn.truth
                if turn.frames:
                    self.receive_autopilot(turn.frames, now_ns)
                    if not self.guards:
                        unread.append(turn.frames)
            due_ns = autopilot.due_ns
            for guard in self.guards:
                if guard.due_ns <= now_ns:
                    busy = True
                    out = guard.tick(now_ns)
                    if out.to_autopilot:
                        autopilot.receive_frames(out.to_autopilot, now_ns)
                        to_autopilot += out.to_autopilot
                    datagrams += out.to_ground
                    events += out.events
                    innovations += out.innovations
                    faults += out.faults
                due_ns = min(due_ns, guard.due_ns)
        return DroneOutgoing(datagrams, truth, events, innovations, faults, to_autopilot, unread, due_ns)

    @property
    def due_ns(self) -> int:
        """When `tick` is due if nothing arrives."""
        due_ns = self.autopilot.due_ns
        for guard in self.guards:
            due_ns = min(due_ns, guard.due_ns)
        return due_ns


class GuardedDrone(Guarded[AgentCore]):
    """One simulated drone."""

    def __init__(
        self, config: SimulatedDroneConfig, t0_ns: int, physics: Physics = OWN, without: frozenset[str] = frozenset()
    ) -> None:
        """physics: what integrates the vehicle; without: monitors of the guard to do without."""
        super().__init__(GuardCore(config, t0_ns, without=without), AgentCore(config, t0_ns, physics))

    def truth(self, now_ns: int) -> Truth:
        """The true state at `now_ns`."""
        return self.autopilot.truth(now_ns)
