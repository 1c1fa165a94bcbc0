"""One drone in a lockstep flight: its guard, the simulated autopilot behind it, and both directions of its link."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from drone_agent.autopilots.model import Task
from drone_agent.config import SimulatedDroneConfig
from drone_agent.guard.core import GuardCore
from drone_agent.guard.navigator import Fault as PoseFault
from drone_agent.guard.setpoints import SETPOINTS
from drone_agent.guarded import GuardedDrone
from drone_agent.simulation.attitude_loop import Physics
from formation.maths.arrays import Float, Quat, Vec3
from formation.messages import Datagram, Event, Innovation, LabFrame
from sim.faults.channel import Channel, Sent
from sim.faults.fault import Family, Fault
from sim.monitors import Without
from sim.process_input import ProcessInput
from sim.scenario import LinkModel, Scenario
from wire.link_messages import BRIDGE_COMPONENT
from wire.mavlink.framing import Frame
from wire.transport.memory_bus import random_delay


class Sample(NamedTuple):
    """The true state of one drone at one instant; lab and flu.

    thrust_n: of all motors together. q_commanded, thrust_commanded: the setpoint of its attitude loop. motor_gain: each
    motor's share of its commanded thrust; lift_most: maximum thrust over weight that does not tilt it. command_sent_ns:
    when a ground first sent the active command; None while the drone flies by itself, or does not fly.
    """

    sysid: int
    pos_lab_m: Vec3
    vel_lab_m_s: Vec3
    q_lab_from_flu: Quat
    armed: bool
    thrust_n: float
    q_commanded: Quat
    thrust_commanded: float
    motor_gain: Float
    lift_most: float
    command_sent_ns: int | None


class DroneNode:
    """One drone.

    Only the guard receives the data of the ground and the mocap. Faults of the agent are of the guard's computer; the
    autopilot, which has its own, flies on.
    """

    __slots__ = (
        "_config", "_guards", "_input", "_received", "_without", "autopilot", "down", "drone", "due_ns", "entered_ns",
        "events", "faults", "followed_ns", "innovations", "row", "sysid", "up",
    )  # fmt: skip

    def __init__(
        self,
        config: SimulatedDroneConfig,
        scenario: Scenario,
        seed: int,
        now_ns: int,
        without: Without,
        physics: Physics,
    ) -> None:
        """without: monitors that are switched off; physics: what integrates the vehicle."""
        self._config = config
        self._without = without.agent
        self.sysid = config.sysid
        # Truth is asked for at every exposure; nobody waits for it to be published.
        silent = config.model_copy(update={"truth_rate_hz": 0.0})
        self.drone = GuardedDrone(silent, now_ns, physics, without.agent)
        self.autopilot = self.drone.autopilot
        self._guards = self.drone.guards
        """While they do not run, too."""
        model = scenario.link
        self.down = _channel(model, model.down_s, [seed, 3, config.sysid])
        self.up = _channel(model, model.up_s, [seed, 4, config.sysid])
        self.due_ns = now_ns
        """When guard or autopilot has something to do of itself, as the last tick left them."""
        self.entered_ns = -1
        """For when the flight has entered it in what is due."""
        self.row = 0
        """Among the flight's drones, in the order in which they are served."""
        self.events: list[Event] = []
        self.innovations: list[Innovation] = []
        self.faults: list[PoseFault] = []
        self.followed_ns: int | None = None
        self._input = ProcessInput[LabFrame | Sent | list[Frame]]()
        self._received = (now_ns, now_ns)
        """When the guards last received a ground's datagram, and when it was sent."""

    def receive_frame(self, frame: LabFrame, now_ns: int) -> None:
        """Receive a mocap frame."""
        if self._input.admits(frame):
            self.drone.receive_frame(frame, now_ns)

    def receive_datagram(self, sent: Sent, now_ns: int) -> Sequence[Datagram]:
        """Receive a ground's datagram; returns the datagrams sent at once."""
        if not self._input.admits(sent):
            return ()
        self._pass_to_guards(sent, now_ns)
        return self.tick(now_ns)

    def tick(self, now_ns: int) -> Sequence[Datagram]:
        """The datagrams for the ground; notes when the followed setpoint was sent, if one was accepted just now."""
        outgoing = self.drone.tick(now_ns)
        self.events += outgoing.events
        self.innovations += outgoing.innovations
        self.faults += outgoing.faults
        for frames in outgoing.unread:
            self._input.admits(frames)
        if outgoing.to_autopilot and self.autopilot.autopilot.stream.last_ns == now_ns:
            received_ns, sent_ns = self._received
            passed = received_ns == now_ns and not _flown_by_guard(outgoing.to_autopilot)
            self.followed_ns = sent_ns if passed else now_ns
        self.due_ns = outgoing.due_ns
        return outgoing.datagrams

    def sample(self) -> Sample:
        """The true state of the drone, at the last millisecond of its physics."""
        autopilot = self.autopilot.autopilot
        frame = self.autopilot.airframe
        state = frame.state
        led = autopilot.task is Task.EXTERNAL
        return Sample(
            self.sysid, state.pos_lab_m, state.vel_lab_m_s, state.q_lab_from_flu, frame.armed,
            sum(state.motor_thrust_n.tolist()), frame.setpoint.q_lab_from_flu, frame.setpoint.thrust_norm,
            frame.motor_gain, level_share(frame.motor_gain) * frame.profile.thrust_max_n / frame.profile.weight_n,
            self.followed_ns if led else None,
        )  # fmt: skip

    def begin(self, fault: Fault, now_ns: int) -> None:
        """A fault of the guard begins."""
        match fault.family:
            case Family.KILL | Family.RESTART:
                self._input.kill()
            case Family.STALL:
                self._input.stall()
            case Family.TWIN:
                self._guards.append(self._new_guard(now_ns))
        self.drone.guards = self._guards if self._input.runs else []

    def end(self, fault: Fault, now_ns: int) -> None:
        """It is over: a stalled guard takes in what has come meanwhile, a restarted one is new."""
        if fault.family is Family.TWIN:
            del self._guards[1:]
            return
        if fault.family is Family.RESTART:
            self._guards[0] = self._new_guard(now_ns)
        self.drone.guards = self._guards
        for item in self._input.resume():
            self._pass_to_guards(item, now_ns)

    def _new_guard(self, now_ns: int) -> GuardCore:
        return GuardCore(self._config, now_ns, without=self._without)

    def _pass_to_guards(self, item: LabFrame | Sent | list[Frame], now_ns: int) -> None:
        if isinstance(item, Sent):
            self.drone.receive(item.datagram, now_ns)
            self._received = (now_ns, item.t_ns)
        elif isinstance(item, LabFrame):
            self.drone.receive_frame(item, now_ns)
        else:
            self.drone.receive_autopilot(item, now_ns)


def level_share(motor_gain: Float) -> float:
    """Of the full thrust, what motors of these gains (4) give without tilting it: as much as the opposite one."""
    front_right, rear_left, front_left, rear_right = motor_gain.tolist()
    return float(0.5 * (min(front_right, rear_left) + min(front_left, rear_right)))


def _flown_by_guard(frames: list[Frame]) -> bool:
    """Whether the last setpoint among these frames is the guard's own."""
    for frame in reversed(frames):
        if frame.number in SETPOINTS:
            return frame.source.component == BRIDGE_COMPONENT
    return False


def _channel(model: LinkModel, delay_s: float, seed: list[int]) -> Channel:
    """One direction of one drone's link, with its own luck."""
    delay = random_delay(delay_s, model.jitter_s, model.lost_share, np.random.default_rng(seed))
    return Channel(delay, np.random.default_rng([*seed, 8]))
