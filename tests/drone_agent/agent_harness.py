"""A ground and a mocap for one simulated drone, joined by function calls: time is a number.

With `pose="mocap"` it has its guard before it, unless `guard=False`.
"""

from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from drone_agent.config import SimulatedDroneConfig
from drone_agent.core import AgentCore
from drone_agent.flight.autopilot import Autopilot
from drone_agent.guard.failsafe import StreamFailsafe
from drone_agent.guarded import GuardedDrone
from drone_agent.simulation.airframe import Airframe
from formation.maths.arrays import Float
from formation.maths.frames import from_rotation_vector
from formation.messages import Datagram, Event, LabFrame, Truth
from wire.link_messages import (
    GROUND,
    Address,
    AttitudeSetpoint,
    CommandAck,
    Ignore,
    LinkMessage,
    Result,
    StatusText,
    VisionPose,
    command_long,
)
from wire.mavlink.codec import Codec

S = 1_000_000_000
MS = 1_000_000
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
M = TypeVar("M")
Stream = Callable[["Harness"], AttitudeSetpoint | None]


class Harness:
    """Runs the core to chosen times and keeps what it says, with the time it said it."""

    def __init__(self, t0_ns: int = 0, **config: Any) -> None:
        self.config = SimulatedDroneConfig(**config)
        self.core = GuardedDrone(self.config, t0_ns) if self.config.is_guarded else AgentCore(self.config, t0_ns)
        self.t0_ns = self.now_ns = t0_ns
        self.target = Address(self.config.sysid, 1)
        self.codec = Codec(GROUND)
        self.heard: list[tuple[int, LinkMessage]] = []
        self.events: list[Event] = []
        self.seq = 0

    @property
    def agent(self) -> AgentCore:
        return self.core.autopilot if isinstance(self.core, GuardedDrone) else self.core

    @property
    def autopilot(self) -> Autopilot:
        return self.agent.autopilot

    @property
    def airframe(self) -> Airframe:
        return self.agent.airframe

    @property
    def stream(self) -> StreamFailsafe:
        """The guard's."""
        assert isinstance(self.core, GuardedDrone)
        return self.core.guards[0]._takeover.stream

    @property
    def truth(self) -> Truth:
        return self.core.truth(self.now_ns)

    def tick(self) -> None:
        out = self.core.tick(self.now_ns)
        self.events += out.events
        for datagram in out.datagrams:
            self.heard += [(self.now_ns, packet.message) for packet in self.codec.receive(datagram.data)]

    def run_to(self, t_ns: int) -> None:
        while (due_ns := self.core.due_ns) <= t_ns:
            self.now_ns = max(due_ns, self.now_ns)
            self.tick()
        self.now_ns = t_ns

    def run(self, seconds: float, stream: Stream | None = None, *, mocap: bool | None = None) -> None:
        """Let time pass. At 100 Hz `stream` gives a setpoint and mocap a frame (by default where it is needed)."""
        mocap = self.config.pose == "mocap" if mocap is None else mocap
        end_ns = self.now_ns + round(seconds * S)
        while self.now_ns < end_ns:
            self.run_to(min(self.now_ns + 10 * MS, end_ns))
            if mocap:
                self.show()
            setpoint = stream(self) if stream is not None else None
            if setpoint is not None:
                self.send(setpoint)

    def show(self, pos_lab_m: Float | None = None, q_lab_from_flu: Float | None = None) -> None:
        """One mocap frame of this drone and a stranger, or the pose as a guard sends it."""
        truth = self.truth
        pos = truth.pos_lab_m if pos_lab_m is None else pos_lab_m
        q = truth.q_lab_from_flu if q_lab_from_flu is None else q_lab_from_flu
        if not isinstance(self.core, GuardedDrone):
            self.send(VisionPose((self.now_ns - self.t0_ns) // 1000, pos, q))
            return
        self.seq += 1
        frame = LabFrame(
            self.seq, self.now_ns, ("stranger", self.config.body_name), np.array([[9.0, 9.0, 9.0], pos]),
            np.array([LEVEL, q]), np.array([True, True]),
        )  # fmt: skip
        self.core.receive_frame(frame, self.now_ns)
        self.tick()

    def send(self, *messages: LinkMessage) -> None:
        data = b"".join(self.codec.encode(message) for message in messages)
        self.core.receive(Datagram(self.config.sysid, data), self.now_ns)
        self.tick()

    def command(self, number: int, *params: float) -> Result:
        """Send a COMMAND_LONG; the result of its acknowledgement."""
        self.send(command_long(self.target, number, *params))
        acks = [m for m in self.of(CommandAck) if m.command == number]
        return acks[-1].result

    def of(self, kind: type[M]) -> list[M]:
        return [message for _, message in self.heard if isinstance(message, kind)]

    def last(self, kind: type[M]) -> M:
        return self.of(kind)[-1]

    def texts(self) -> list[str]:
        return [text.text for text in self.of(StatusText)]

    def fly_offboard(self, height_m: float = 0.5, stream: Stream | None = None) -> None:
        """Off-board from the ground to a hover at about `height_m`, by a stream of attitude targets."""
        stream = stream or hover_at(height_m)
        self.run(3.0)
        self.run(0.2, idle)
        main = 6.0 if self.config.autopilot == "px4" else 4.0
        assert self.command(176, 1.0, main) is Result.ACCEPTED
        assert self.command(400, 1.0) is Result.ACCEPTED
        self.run(4.0, stream)


def target(harness: Harness, thrust: float, q: Float = LEVEL, ignore: Ignore = Ignore.BODY_RATES) -> AttitudeSetpoint:
    return AttitudeSetpoint(harness.target, harness.now_ns // MS, q, np.zeros(3), thrust, ignore)


def idle(harness: Harness) -> AttitudeSetpoint:
    return target(harness, 0.0)


def hover_at(height_m: float) -> Stream:
    """A height controller on the truth: enough of a ground for these tests."""

    def stream(harness: Harness) -> AttitudeSetpoint:
        profile = harness.config.true_vehicle()
        truth = harness.truth
        climb = 9.8 + 6.0 * (height_m - truth.pos_lab_m[2]) - 4.0 * truth.vel_lab_m_s[2]
        return target(harness, profile.thrust_norm_of(profile.mass_kg * climb))

    return stream


def hover_over(x_m: float, y_m: float, height_m: float) -> Stream:
    """A position controller on the truth."""
    place = np.array([x_m, y_m])

    def stream(harness: Harness) -> AttitudeSetpoint:
        truth, level = harness.truth, hover_at(height_m)(harness)
        assert level is not None
        asked = 1.5 * (place - truth.pos_lab_m[:2]) - 2.2 * truth.vel_lab_m_s[:2]
        lean = np.clip(asked / 9.8, -0.2, 0.2)
        return level._replace(q_lab_from_flu=from_rotation_vector(np.array([-lean[1], lean[0], 0.0])))

    return stream


def tilt_rad(q_lab_from_flu: Float) -> float:
    """Angle between the body's up and the lab's."""
    _, x, y, _ = q_lab_from_flu
    return float(np.arccos(np.clip(1.0 - 2.0 * (x * x + y * y), -1.0, 1.0)))
