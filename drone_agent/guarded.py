"""A simulated drone: the guard, and the simulated autopilot behind it, joined in memory as by a cable. No sockets.

The guard is the one that stands beside a real autopilot (drone_agent.guard.core); it alone hears ground and mocap.
"""

from typing import NamedTuple

from drone_agent.config import SimulatedDroneConfig
from drone_agent.core import AgentCore
from drone_agent.guard.core import GuardCore
from drone_agent.guard.navigator import Fault
from drone_agent.simulation.attitude_loop import OWN, Physics
from formation.messages import Datagram, Event, Innovation, LabFrame, Truth


class DroneOutgoing(NamedTuple):
    """What one tick gives: for the ground, and of what guard and autopilot exchanged."""

    datagrams: tuple[Datagram, ...]
    truth: Truth | None
    events: tuple[Event, ...]
    innovations: tuple[Innovation, ...]
    faults: tuple[Fault, ...]
    to_autopilot: tuple[Datagram, ...]
    unread: tuple[bytes, ...]
    """Datagrams of the autopilot while there is no guard."""


class GuardedDrone:
    """One drone. Call `receive` with what arrives and `tick` no later than `next_deadline_ns`."""

    def __init__(
        self, config: SimulatedDroneConfig, t0_ns: int, physics: Physics = OWN, without: frozenset[str] = frozenset()
    ) -> None:
        """physics: what integrates the vehicle; without: monitors of the guard to do without."""
        self.guards = [GuardCore(config, t0_ns, without=without)]
        """One; in a simulation of faults none, or two that were started by mistake."""
        self.autopilot = AgentCore(config, t0_ns, physics)
        self.due_ns = t0_ns
        """`next_deadline_ns` as the last tick left it: right while nothing has arrived since."""

    def receive(self, message: Datagram | LabFrame | bytes, now_ns: int) -> None:
        """Receive the ground's datagram, a mocap frame or bytes of the autopilot. Never raises on what they hold."""
        for guard in self.guards:
            if isinstance(message, LabFrame):
                guard.receive_frame(message, now_ns)
            elif isinstance(message, Datagram):
                guard.receive_ground(message, now_ns)
            else:
                guard.receive_autopilot(message, now_ns)

    def tick(self, now_ns: int) -> DroneOutgoing:
        """Everything to send now; guard and autopilot exchange theirs, without delay, until neither has more."""
        datagrams: list[Datagram] = []
        events: list[Event] = []
        innovations: list[Innovation] = []
        faults: list[Fault] = []
        to_autopilot: list[Datagram] = []
        unread: list[bytes] = []
        truth: Truth | None = None
        busy = True
        while busy:
            due_ns = self.autopilot.next_deadline_ns()
            busy = due_ns <= now_ns
            if busy:
                own = self.autopilot.tick(now_ns)
                truth = own.truth or truth
                events += own.events
                for datagram in own.datagrams:
                    self.receive(datagram.data, now_ns)
                    if not self.guards:
                        unread.append(datagram.data)
            for guard in self.guards:
                guard_due_ns = guard.next_deadline_ns()
                due_ns = min(due_ns, guard_due_ns)
                if guard_due_ns <= now_ns:
                    busy = True
                    out = guard.tick(now_ns)
                    for datagram in out.to_autopilot:
                        self.autopilot.receive(datagram, now_ns)
                    datagrams += out.to_ground
                    events += out.events
                    innovations += out.innovations
                    faults += out.faults
                    to_autopilot += out.to_autopilot
        self.due_ns = due_ns
        return DroneOutgoing(
            tuple(datagrams), truth, tuple(events),
            tuple(innovations), tuple(faults), tuple(to_autopilot), tuple(unread),
        )  # fmt: skip

    def next_deadline_ns(self) -> int:
        """When `tick` is due if nothing arrives."""
        return min([self.autopilot.next_deadline_ns(), *[guard.next_deadline_ns() for guard in self.guards]])

    def truth(self, now_ns: int) -> Truth:
        """The true state at `now_ns`."""
        return self.autopilot.truth(now_ns)
