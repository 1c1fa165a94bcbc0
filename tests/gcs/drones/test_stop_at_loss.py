"""How long a stop takes to reach a drone over a link that loses packets: the ground's end of it, trial by trial."""

import heapq

import numpy as np

from formation.config import VehicleBody
from formation.vehicle.profile import profile
from gcs.drones.drone import Drone
from gcs.drones.link_state import DroneLink
from gcs.drones.stages import Trigger
from wire.link_messages import Address, CommandAck, CommandLong, Heartbeat, MavAutopilot, MavCommand, Result
from wire.mavlink.codec import Codec

MS = 1_000_000
GIVE_UP_NS = 10_000 * MS
HEARTBEAT_NS = 1_000 * MS


class Trial:
    """One drone that is armed, its link, and a stop at time zero; `cut_ns`: when its motors stopped."""

    def __init__(self, rng: np.random.Generator, loss: float, delay_ns: int, jitter_ns: int) -> None:
        self._rng, self._loss, self._delay_ns, self._jitter_ns = rng, loss, delay_ns, jitter_ns
        self._drone = Drone(0, DroneLink(VehicleBody(body="left", sysid=2), 2, profile("paper_40g")))
        self._codec = Codec(Address(2, 1))
        self._events: list[tuple[int, int, str, bytes]] = []
        self._armed = True
        self.cut_ns: int | None = None
        self.confirmed_ns: int | None = None

    def run(self) -> None:
        """Until the ground knows that the motors are off, or ten seconds."""
        link, now_ns = self._drone.link, 0
        link.receive(self._codec.encode(self._heartbeat()), -1)
        beat_ns = int(self._rng.integers(HEARTBEAT_NS))
        self._drone.enter(Trigger.STOP, 0)
        while now_ns < GIVE_UP_NS:
            self._drone.pursue(now_ns)
            for message in link.due(now_ns):
                if isinstance(message, CommandLong):
                    self._send(now_ns, "down", link.codec.encode(message))
            if self._drone.reached:
                self.confirmed_ns = now_ns
                return
            due_ns = link.commands.urgent_ns
            next_ns = now_ns + 10 * MS if due_ns is None else due_ns
            arrival_ns = self._events[0][0] if self._events else GIVE_UP_NS
            now_ns = min(next_ns, arrival_ns, beat_ns)
            if now_ns == beat_ns:
                beat_ns += HEARTBEAT_NS
                self._send(now_ns, "up", self._codec.encode(self._heartbeat()))
            while self._events and self._events[0][0] <= now_ns:
                self._arrive(now_ns, *heapq.heappop(self._events)[2:])

    def _heartbeat(self) -> Heartbeat:
        return Heartbeat(MavAutopilot.PX4, 2, 129 if self._armed else 1, 6 << 16, 4)

    def _send(self, now_ns: int, way: str, data: bytes) -> None:
        if self._rng.random() >= self._loss:
            delay_ns = self._delay_ns + int(self._jitter_ns * self._rng.standard_exponential())
            heapq.heappush(self._events, (now_ns + delay_ns, len(self._events), way, data))

    def _arrive(self, now_ns: int, way: str, data: bytes) -> None:
        if way == "up":
            self._drone.link.receive(data, now_ns)
            return
        for packet in self._codec.receive(data):
            if not isinstance(packet.message, CommandLong):
                continue
            if packet.message.command == MavCommand.REQUEST_MESSAGE:
                self._send(now_ns, "up", self._codec.encode(self._heartbeat()))
            else:
                self._armed = False
                self.cut_ns = now_ns if self.cut_ns is None else self.cut_ns
                self._send(now_ns, "up", self._codec.encode(CommandAck(packet.source, 400, Result.ACCEPTED)))


def times_s(trials: int, loss: float, seed: int, delay_ns: int = 2 * MS, jitter_ns: int = 1 * MS) -> np.ndarray:
    """From the stop to zero thrust, s, of each trial; infinite where it never came."""
    rng, out = np.random.default_rng(seed), np.full(trials, np.inf)
    for k in range(trials):
        trial = Trial(rng, loss, delay_ns, jitter_ns)
        trial.run()
        out[k] = np.inf if trial.cut_ns is None else trial.cut_ns * 1e-9
    return out


def test_a_stop_reaches_every_drone_at_twenty_percent_loss_within_a_tenth_of_a_second() -> None:
    taken_s = times_s(2000, 0.2, seed=3)
    assert np.isfinite(taken_s).all()
    assert np.quantile(taken_s, 0.999) <= 0.1
    assert np.median(times_s(50, 0.95, seed=3)) > 0.05  # a link that loses nearly all is another matter
