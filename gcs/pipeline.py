"""From a mocap frame to one datagram's worth of setpoints: alignment, then the control stack. Deterministic."""

from formation.arrays import Float
from formation.config import LabConfig
from formation.control.stack import ControlStack, Stages
from formation.messages import MocapFrame
from formation.mocap_axes import MocapAxes
from formation.reference import Plan


class Pipeline:
    """Alignment and control of one lab."""

    def __init__(self, config: LabConfig) -> None:
        self.axes = MocapAxes(config.mocap, config.vehicles)
        self._stack = ControlStack(config, tuple(config.profile_of(vehicle) for vehicle in config.vehicles))

    def align(self, frame: MocapFrame) -> MocapFrame:
        """The frame in lab and flu, of the n vehicles in the configuration's order."""
        return self.axes.align(frame)

    def step(self, now_ns: int, aligned: MocapFrame, plan: Plan, hover_thrust_norm: Float) -> Stages:
        """One aligned frame through every stage."""
        return self._stack.step(now_ns, aligned, plan, hover_thrust_norm)
