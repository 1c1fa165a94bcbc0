"""All that a page's process knows: the newest states, alarms, trails, and who of several viewers may command. Pure."""

from dataclasses import dataclass, field, replace
from typing import Any

from formation.config import LabConfig
from formation.messages import Event, EventCode, Severity, Verb
from gcs.alarms import ShownAlarms
from gcs.page.scene import Scene, Trails, scene
from gcs.page.show import LOST_S, MOCAP_LOST_NS, NOTHING_YET, Show, none_of_ours, rehearsed, show
from gcs.rehearsal import Rehearsal, lab_name
from wire.ground_state import GroundState, decode

SILENT = Event(
    Severity.CRITICAL, "page", "the ground is not heard any more", lasts=True, code=EventCode.GROUND_SILENT
)  # fmt: skip


@dataclass(slots=True)
class Control:
    """Viewers by name, in order of their coming; the first has the control until it leaves or another takes it."""

    holder: str | None = None
    previous: str | None = None
    """Who had the control before the holder took it over."""
    viewers: list[str] = field(default_factory=list)

    def come(self, viewer: str, *, may_command: bool = True) -> None:
        """A viewer has opened the page; may_command: whether its role allows more than a stop."""
        if viewer not in self.viewers:
            self.viewers.append(viewer)
        if self.holder is None and may_command:
            self.holder = viewer

    def leave(self, viewer: str) -> None:
        """A viewer has gone; if it had the control, nobody has it: somebody must take it."""
        if viewer in self.viewers:
            self.viewers.remove(viewer)
        if self.holder == viewer:
            self.holder = None

    def take_control(self, viewer: str) -> None:
        """A viewer takes the control over."""
        if self.holder not in (None, viewer):
            self.previous = self.holder
        self.holder = viewer

    def status_text(self, viewer: str) -> str:
        """The status text for a viewer; empty for one that is alone and has the control."""
        if self.holder == viewer:
            others = len(self.viewers) - 1
            return "" if others < 1 else f"{others} more {'viewer looks' if others == 1 else 'viewers look'} on"
        if self.holder is None:
            return "Nobody has the control: this page is read-only until you take it"
        handover = f"{self.holder} has taken the control over from {viewer}. " if self.previous == viewer else ""
        return f"{handover}Read-only: {self.holder} has the control"


class Model:
    """Receives the published states and computes what is shown; times are on the flight's clock, ns."""

    def __init__(self, config: LabConfig) -> None:
        self.config = config
        self.alarms = ShownAlarms()
        self.control = Control()
        self.state: GroundState | None = None
        self.scene = Scene((), (), (), ())
        self.rehearsal: Rehearsal | None = None
        self._lab_name = lab_name(config)
        self._mocap: dict[str, Any] | None = None
        self._trails = Trails()
        self._state_ns = self._mocap_ns = 0
        self._lost = False

    def receive_state(self, text: str, now_ns: int) -> None:
        """Receive the ground's published state; ValueError, without effect, for another version's."""
        state = decode(text)
        with none_of_ours("ground"):
            show(state, None, 0.0)
            self.scene = scene(state, self.config, self._trails)
            self.alarms.receive_ground(state)
        self.state, self._state_ns = state, now_ns

    def receive_mocap_state(self, state: dict[str, Any], now_ns: int) -> None:
        """Receive the mocap process's published state; ValueError for another version's."""
        if self.state is None:
            return  # it comes again each second
        with none_of_ours("mocap process"):
            show(self.state, state, 0.0)
        self._mocap, self._mocap_ns = state, now_ns

    def show(self, now_ns: int, unix_s: float) -> Show:
        """The view now; a ground that falls silent is an alarm until it is heard again."""
        if self.state is None:
            return NOTHING_YET
        silent_s = (now_ns - self._state_ns) * 1e-9
        lost = silent_s > LOST_S
        if lost and not self._lost:
            self.alarms.retain_ground_alarms()
        if lost is not self._lost:
            self.alarms.receive(SILENT if lost else SILENT.over(), unix_s)
        self._lost = lost
        mocap = self._mocap if now_ns - self._mocap_ns < MOCAP_LOST_NS else None
        shown = show(self.state, mocap, silent_s)
        return replace(shown, vital=(*shown.vital, ("rehearsal", rehearsed(self.rehearsal, self._lab_name))))

    @property
    def may_choose(self) -> bool:
        """Whether a trajectory of the leader's can be chosen now."""
        return self.state is not None and not self.state.allowed[Verb.TRAJECTORY]
