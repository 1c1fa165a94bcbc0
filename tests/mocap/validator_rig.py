"""A rig for the pose validator's tests: a hand-held leader and two drones, as noisy cameras of any axes show them."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from formation.config import LabConfig
from formation.maths import frames
from formation.maths.arrays import Float
from formation.messages import LabFrame, RawFrame, Rejection
from mocap.core import MocapCore

MS = 1_000_000
T0_NS = 10**12
BODIES = ("lead", "left", "right")
POSITIONS_LAB_M = np.array([[0.0, 0.0, 1.0], [-0.5, 0.5, 1.0], [-0.5, -0.5, 1.0]])
UPRIGHT = {"mocap": (1.0, 0.0, 0.0, 0.0), "left": (1.0, 0.0, 0.0, 0.0)}
HALF = 0.5**0.5
TURNED = {"mocap": (HALF, HALF, 0.0, 0.0), "left": (0.5, -0.5, 0.5, 0.5)}

Fault = Callable[[int, Float, Float], None]
"""Called with the frame's number, it changes the poses in lab and flu: positions (3, 3), quaternions (3, 4)."""


def lab(mounting: dict[str, tuple[float, ...]]) -> LabConfig:
    return LabConfig.model_validate(
        {
            "mocap": {"q_lab_from_mocap": mounting["mocap"], "origin_lab_m": (0.3, -0.2, 0.1)},
            "leader": {"body": "lead"},
            "followers": [
                {"body": "left", "sysid": 2, "offset_m": (-0.5, 0.5, 0), "q_marker_from_flu": mounting["left"]},
                {"body": "right", "sysid": 3, "offset_m": (-0.5, -0.5, 0)},
            ],
        }
    )


@dataclass
class ValidatorRig:
    """Frames of 100 Hz through one MocapCore; the drones hover after a second on the floor."""

    mounting: dict[str, tuple[float, ...]] = field(default_factory=lambda: UPRIGHT)
    without: frozenset[str] = frozenset()
    noise_m: float = 1e-4
    noise_rad: float = 1e-3
    motion: Callable[[float], Float] = lambda _t_s: POSITIONS_LAB_M
    attitude: Callable[[float], Float] = lambda _t_s: np.tile(frames.IDENTITY, (3, 1))
    shown: list[LabFrame] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.config = lab(self.mounting)
        self.core = MocapCore(self.config, without=self.without)
        self.events: list[str] = []
        self._rng = np.random.default_rng(7)
        self._k = 0
        self._standing = True
        self.arm(False)
        self.fly(100)
        self._standing = False
        self.arm(True)
        for k in range(100):  # up they go, at 1 m/s
            self._standing = True
            self.show(height_m=0.01 * k)
        self._standing = False
        self.fly(20)
        self.shown.clear()

    def arm(self, on: bool) -> None:
        """The ground says of both drones whether their motors are on."""
        self.core.note_motors({"left": on, "right": on})

    def fly(self, count: int, fault: Fault = lambda *_: None, seen: tuple[bool, ...] = (True, True, True)) -> None:
        """So many frames, each changed by the fault, which is called with 0 for the first."""
        for k in range(count):
            self.show(lambda pos, q, k=k: fault(k, pos, q), seen)

    def pause(self, count: int) -> None:
        """So many frames that nobody sees."""
        self._k += count

    @property
    def t_s(self) -> float:
        """When the next frame is exposed, as `motion` counts."""
        return 1e-8 * self._k * MS

    def show(self, change=lambda *_: None, seen=(True, True, True), height_m: float = 0.0, stamp_ns: int = 0) -> None:
        """One frame; stamp_ns: how much later than its exposure it says it was taken."""
        t_ns = T0_NS + self._k * 10 * MS
        t_s = self.t_s
        pos = self.motion(t_s).copy()
        if self._standing:
            pos[1:, 2] = height_m
        pos += self.noise_m * self._rng.standard_normal((3, 3))
        small = np.concatenate([np.ones((3, 1)), 0.5 * self.noise_rad * self._rng.standard_normal((3, 3))], axis=1)
        q = frames.canonical(frames.multiply(self.attitude(t_s), frames.canonical(small)))
        change(pos, q)
        raw = self._raw(t_ns + stamp_ns, pos, q, np.array(seen))
        now_ns = t_ns + 8 * MS
        frame = self.core.receive(raw, now_ns)
        if frame is not None:
            self.shown.append(frame)
        self.events += [event.text for event in self.core.events(now_ns)]
        self._k += 1

    def _raw(self, t_ns: int, pos: Float, q: Float, seen: np.ndarray) -> RawFrame:
        """The poses in the cameras' axes and marker frames."""
        mocap = self.config.mocap
        q_mocap_from_lab = frames.inverse(np.array(mocap.q_lab_from_mocap))
        q_flu_from_marker = frames.inverse(np.array([v.q_marker_from_flu for v in self.config.vehicles]))
        pos_mocap_m = frames.rotate(q_mocap_from_lab, pos - np.array(mocap.origin_lab_m))
        q_mocap = frames.multiply(frames.multiply(q_mocap_from_lab, q), q_flu_from_marker)
        return RawFrame(self._k, t_ns, BODIES, pos_mocap_m, q_mocap, seen)

    def codes(self, body: str) -> list[Rejection]:
        """Of each frame shown: why the body was rejected in it."""
        i = BODIES.index(body)
        return [Rejection(frame.rejected[i]) for frame in self.shown]

    def seen(self, body: str) -> list[bool]:
        """Of each frame shown: whether it was seen."""
        i = BODIES.index(body)
        return [bool(frame.seen[i]) for frame in self.shown]
