"""A scene for emulated cameras without any drone: bodies at rest, or circling. Pure."""

from math import cos, pi, sin

import numpy as np

from formation.config import FollowerConfig, LabConfig, LeaderConfig
from formation.maths import frames
from formation.messages import RawFrame, Truth
from formation.mocap_config import MocapConfig
from sim.cameras.emulator import EmulatorConfig, MocapEmulator
from sim.cameras.playback import Playback

SPACING_M, ACROSS, HEIGHT_M, LEVELS, LEVEL_M = 0.6, 5, 0.3, 7, 0.05
RADIUS_M, PERIOD_S, TURN_PERIOD_S = 0.2, 6.0, 15.0

STOOD_STILL_NS = 500_000_000
"""A process so late was stopped: it skips the frames of that time, since sending them would delay later ones."""


class CirclingScene:
    """Each body circles about its grid point, 0.2 m from it, and yaws slowly; at rest where `still`.

    leader: how the first body moves instead, if recorded.
    """

    def __init__(
        self, lab: LabConfig, cameras: EmulatorConfig, still: bool, leader: Playback | None, seed: int, t0_ns: int
    ) -> None:
        self.bodies = tuple(v.body for v in lab.vehicles)
        self._cameras = MocapEmulator(cameras, _carried(lab, leader is not None), leader, seed, t0_ns)
        self._cameras.start(t0_ns)
        self._first = 0 if leader is None else 1
        self._still = still
        self._t0_ns = t0_ns

    @property
    def next_ns(self) -> int:
        """When `frames` is due again."""
        return min(self._cameras.next_exposure_ns, self._cameras.next_frame_ns)

    def frames(self, now_ns: int) -> list[RawFrame]:
        """The frames that leave the cameras' computer by now."""
        if now_ns - self._cameras.next_exposure_ns > STOOD_STILL_NS:
            self._cameras.skip_to(now_ns)
        while (t_ns := self._cameras.next_exposure_ns) <= now_ns:
            self._cameras.expose({i + 1: self._truth(i, t_ns) for i in range(self._first, len(self.bodies))})
        return self._cameras.pop_due(now_ns)

    def _truth(self, i: int, t_ns: int) -> Truth:
        t_s = 0.0 if self._still else (t_ns - self._t0_ns) * 1e-9
        w, turn = (0.0, 0.0) if self._still else (2.0 * pi / PERIOD_S, 2.0 * pi / TURN_PERIOD_S)
        angle, yaw = w * t_s + i, turn * t_s + 0.3 * i
        centre = ((i // ACROSS) * SPACING_M, (i % ACROSS - ACROSS // 2) * SPACING_M, HEIGHT_M + LEVEL_M * (i % LEVELS))
        pos = np.array(centre) + RADIUS_M * np.array([cos(angle), sin(angle), 0.0])
        vel = RADIUS_M * w * np.array([-sin(angle), cos(angle), 0.0])
        q = frames.from_yaw(np.array(yaw))
        return Truth(t_ns, i + 1, pos, vel, q, np.array([0.0, 0.0, turn]), np.zeros(3), False)


def lab_of(names: tuple[str, ...], mocap: MocapConfig) -> LabConfig:
    """A lab of bodies of these names, two at least."""
    followers = tuple(
        FollowerConfig(body=name, sysid=i, offset_m=(-0.5 * i, 0.0, 0.0)) for i, name in enumerate(names[1:], start=2)
    )
    return LabConfig(leader=LeaderConfig(body=names[0], sysid=1), followers=followers, mocap=mocap)


def _carried(lab: LabConfig, led: bool) -> LabConfig:
    """Body i is sysid i + 1, the leader nobody's where a recording carries it."""
    leader = lab.leader.model_copy(update={"sysid": None if led else 1})
    followers = tuple(f.model_copy(update={"sysid": i}) for i, f in enumerate(lab.followers, start=2))
    return lab.model_copy(update={"leader": leader, "followers": followers})
