"""All that a page's process knows: the newest states, alarms, trails, who has the control. Pure."""

from typing import Any

from formation.config import LabConfig
from formation.messages import Event, EventCode, Phase, Severity, Verb
from gcs.page.alarms import ShownAlarms
from gcs.page.control import Control
from gcs.page.foresee import Foreseen, shape, start, trajectory
from gcs.page.scene import Scene, Trails, scene
from gcs.page.show import NOTHING_YET, SILENT_S, Show, none_of_ours, show
from wire.ground_state import GroundState, decode

START_NS = 1_000_000_000


class Model:
    """Receives the published states and computes what is shown; times are on the flight's clock, ns."""

    def __init__(self, config: LabConfig) -> None:
        self.config = config
        self.alarms = ShownAlarms()
        self.control = Control()
        self.state: GroundState | None = None
        self.scene = Scene((), (), (), ())
        self.start: Foreseen | None = None
        self._mocap: dict[str, Any] | None = None
        self._trails = Trails()
        self._state_ns = self._mocap_ns = self._start_ns = 0
        self._lost = False

    def receive_state(self, text: str, now_ns: int) -> None:
        """Receive the ground's published state; ValueError, without effect, for another version's."""
        state = decode(text)
        with none_of_ours("ground"):
            show(state, None, 0.0)
            self.scene = scene(state, self.config, self._trails)
            self.alarms.receive_ground(state)
            if now_ns - self._start_ns > START_NS:
                self._start_ns = now_ns
                self.start = start(state, self.config) if state.phase is Phase.HOLD else None
        self.state, self._state_ns, self._lost = state, now_ns, False

    def receive_mocap_state(self, state: dict[str, Any], now_ns: int) -> None:
        """Receive the mocap process's published state; ValueError for another version's."""
        if self.state is None:
            return  # it comes again each second
        with none_of_ours("mocap process"):
            show(self.state, state, 0.0)
        self._mocap, self._mocap_ns = state, now_ns

    def show(self, now_ns: int, unix_s: float) -> Show:
        """What is to be shown now; a ground that falls silent is an alarm, once."""
        if self.state is None:
            return NOTHING_YET
        silent_s = (now_ns - self._state_ns) * 1e-9
        if silent_s > SILENT_S and not self._lost:
            self._lost = True
            self.alarms.retain_ground_alarms()
            self.alarms.receive(
                Event(Severity.CRITICAL, "page", "the ground is not heard any more", code=EventCode.GROUND_SILENT),
                unix_s,
            )
        mocap = self._mocap if now_ns - self._mocap_ns < 3 * START_NS else None
        return show(self.state, mocap, silent_s, () if self.start is None else self.start.against)

    @property
    def may_choose(self) -> bool:
        """Whether a trajectory of the leader's can be chosen now."""
        return self.state is not None and not self.state.allowed[Verb.TRAJECTORY]

    def foresee(self, asked: str) -> Foreseen | None:
        """A shape before it is asked for; None until the ground was heard."""
        return None if self.state is None else shape(asked, self.state, self.config)

    def foresee_trajectory(self, asked: str) -> Foreseen | None:
        """A trajectory of the leader's before it is asked for; likewise."""
        return None if self.state is None else trajectory(asked, self.state, self.config)
