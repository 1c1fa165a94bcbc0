"""A Crazyflie's upper half: an autopilot of ours over the vehicle that CRTP speaks to. No socket, no clock."""

from typing import Literal

import numpy as np
from pydantic import field_validator

from drone_agent.autopilots.model import Task
from drone_agent.autopilots.parameters import Parameters
from drone_agent.config import AutopilotConfig
from drone_agent.core import AgentTurn, AutopilotCore
from drone_agent.crazyflie.model import CRAZYFLIE_MODEL
from drone_agent.crazyflie.vehicle import Crazyflie
from drone_agent.flight.vehicle import ExternalPose
from formation.maths.frames import IDENTITY
from formation.model import Name
from formation.vehicle.profile import profile
from wire.autopilots.crazyflie import CRAZYFLIE
from wire.crtp import is_address


class CrazyflieConfig(AutopilotConfig):
    """One guard before a Crazyflie; those of one radio are one process."""

    bridge: str
    """Its address: radio://DONGLE/CHANNEL/RATE/ADDRESS, or udp://HOST:PORT of firmware in the loop."""
    profile: Name = "crazyflie_27g"
    pose: Literal["mocap"] = "mocap"

    @field_validator("bridge")
    @classmethod
    def _is_address(cls, bridge: str) -> str:
        if not is_address(bridge):
            raise ValueError(f"{bridge!r} is not radio://DONGLE/CHANNEL/RATE/ADDRESS or udp://HOST:PORT")
        return bridge


def warm_up() -> None:
    """Compile what a Crazyflie's upper half calls: nothing compiles in flight."""
    drone = CrazyflieCore(CrazyflieConfig(bridge="udp://127.0.0.1:19850"), 0)
    pose = ExternalPose(0, np.zeros(3), IDENTITY.copy())
    drone.crazyflie.receive_pose(pose, 0, drone.autopilot.fusion)
    drone.autopilot.arm(0, force=True)
    drone.autopilot.fly(Task.TAKEOFF, rise_m=1.0)
    drone.autopilot.control(0)
    drone.turn(0)


class CrazyflieCore(AutopilotCore):
    """One Crazyflie as an autopilot. Call a `receive` with what arrives and `turn` no later than `due_ns`."""

    def __init__(self, config: CrazyflieConfig, t0_ns: int) -> None:
        configured = profile(config.profile, config.profiles)
        hover = round(configured.hover_thrust_norm, 3)  # those of the firmware are what it says, once it is connected
        own = {"BRIDGE_SYSID": float(config.sysid), "BRIDGE_HOVER": hover, **config.parameters}
        parameters = Parameters(CRAZYFLIE, own)
        self.crazyflie = Crazyflie(configured, parameters, t0_ns)
        super().__init__(config, CRAZYFLIE_MODEL, parameters, t0_ns, self.crazyflie, self.crazyflie)

    def receive_packet(self, data: bytes, now_ns: int) -> None:
        """Receive a packet of the vehicle. Never raises on what it holds."""
        self._run_to(now_ns)
        self.crazyflie.receive(data, now_ns)
        self._update_due()

    def turn(self, now_ns: int) -> AgentTurn:
        """Everything to send now; for the vehicle, `pop_packets`."""
        self.crazyflie.tick(now_ns)
        reason = self.crazyflie.reject_reason(now_ns) if self.autopilot.armed else None
        if reason is not None:
            self.autopilot.disarm(force=True, reason=reason)
        for note in self.crazyflie.notes:
            self.autopilot.report(note.severity, note.text)
        self.crazyflie.notes.clear()
        return super().turn(now_ns)

    def pop_packets(self) -> list[bytes]:
        """The packets for the vehicle, in order."""
        packets, self.crazyflie.outbox = self.crazyflie.outbox, []
        return packets

    def _update_due(self) -> None:
        super()._update_due()
        self.due_ns = min(self.due_ns, self.crazyflie.due_ns)
