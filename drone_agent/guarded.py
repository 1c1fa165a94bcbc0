"""A simulated drone: the guard, and the simulated autopilot behind it, joined in memory as by a cable. No sockets.

The guard is the one that stands beside a real autopilot (drone_agent.bridge.core); it alone hears ground and mocap.
"""

from drone_agent.bridge.core import BridgeCore
from drone_agent.config import AgentConfig
from drone_agent.core import AgentCore, AgentOutgoing
from formation.messages import Datagram, Event, LabFrame, Truth


class GuardedDrone:
    """One drone. Call `receive` with what arrives and `tick` no later than `next_deadline_ns`."""

    def __init__(self, config: AgentConfig, t0_ns: int) -> None:
        self.guard = BridgeCore(config, t0_ns)
        self.behind = AgentCore(config, t0_ns)

    def receive(self, message: Datagram | LabFrame, now_ns: int) -> None:
        """Take in a datagram from the ground or a mocap frame. Never raises on what a datagram holds."""
        if isinstance(message, LabFrame):
            self.guard.receive_frame(message, now_ns)
        else:
            self.guard.receive_ground(message, now_ns)

    def tick(self, now_ns: int) -> AgentOutgoing:
        """Everything to send now; guard and autopilot exchange theirs, without delay, until neither has more."""
        datagrams: list[Datagram] = []
        events: list[Event] = []
        truth: Truth | None = None
        parameters: dict[str, float] | None = None
        while self.next_deadline_ns() <= now_ns:
            own = self.behind.tick(now_ns)
            truth = own.truth or truth
            parameters = parameters if own.parameters is None else own.parameters
            for datagram in own.datagrams:
                self.guard.receive_autopilot(datagram.data, now_ns)
            guards = self.guard.tick(now_ns)
            for datagram in guards.to_autopilot:
                self.behind.receive(datagram, now_ns)
            datagrams += guards.to_ground
            events += (*own.events, *guards.events)
        return AgentOutgoing(tuple(datagrams), truth, tuple(events), parameters)

    def next_deadline_ns(self) -> int:
        """When `tick` is due if nothing arrives."""
        return min(self.behind.next_deadline_ns(), self.guard.next_deadline_ns())

    def truth(self, now_ns: int) -> Truth:
        """The true state at `now_ns`."""
        return self.behind.truth(now_ns)
