"""From a mocap frame to one datagram's worth of setpoints: alignment, then the control stack. Deterministic."""

from formation.arrays import Float
from formation.config import LabConfig
from formation.control.stack import ControlStack, Stages
from formation.frames import rotate_about_z
from formation.messages import MocapFrame
from formation.reference import Plan
from formation.shape import Shape, assigned, configured
from gcs.mocap.axes import MocapAxes


class Pipeline:
    """Alignment and control of one lab."""

    def __init__(self, config: LabConfig) -> None:
        self.axes = MocapAxes(config)
        self._config = config
        self._stack = ControlStack(config, tuple(config.profile_of(vehicle) for vehicle in config.vehicles))

    def align(self, frame: MocapFrame) -> MocapFrame:
        """The frame in lab and flu, of the n vehicles in the configuration's order."""
        return self.axes.align(frame)

    def shape(self, name: str, stages: Stages | None) -> Shape | str:
        """The shape of that name, its slots dealt for least travel from where the followers are; or what is wrong."""
        if name != "configured":
            return f"no shape {name!r}; known: configured"
        wanted = configured(self._config)
        if stages is None:
            return wanted
        state = stages.state
        between = state.pos_lab_m[1:] - state.pos_lab_m[0]
        return assigned(wanted, rotate_about_z(-state.yaw_rad[0], between))

    def step(self, now_ns: int, aligned: MocapFrame, plan: Plan, hover_thrust_norm: Float) -> Stages:
        """One aligned frame through every stage."""
        return self._stack.step(now_ns, aligned, plan, hover_thrust_norm)
