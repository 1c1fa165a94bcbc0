"""The motion-capture emulator, sans-IO: true poses in; jittered, noisy, late, sometimes missing frames out.

It speaks the mocap's axes and marker frames, as a real system does: the mocap process turns them into lab and flu.
Noise is drawn in lab and flu, so that the same flight is the same in a room of any axes.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from formation.config import LabConfig
from formation.maths import frames
from formation.maths.arrays import Bool, Float
from formation.maths.kernel import kernel
from formation.maths.quaternion import multiply_into, rotate_into, turn_into
from formation.messages import RawFrame, Truth
from formation.model import Model, Positive
from sim.cameras.playback import Playback
from wire.transport.memory_bus import MemoryLink, random_delay

NotNegative = Annotated[float, Field(ge=0.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
TRUTH_LIVES_NS = 10_000_000
"""A body whose truth is older is not seen: its process is late, or gone. Cameras do not guess where a body may be; from
a truth that old, 5 m/s^2 make 0.25 mm."""

IN_BURST_NS = 1_000
"""Frames that arrive together are stamped so far from each other."""


class Gap(Model):
    """A time without frames, or without one body; `at_s` counts from the start of the formation phase.

    Without frames a camera system's server, where one is flown with, is gone for as long.
    """

    at_s: float
    for_s: Positive
    body: str | None = None


class EmulatorConfig(Model):
    """How far the emulated mocap is from an ideal one.

    jitter_s, noise_m and noise_rad are standard deviations (of the exposure's time; per axis), delay_jitter_s the mean
    of what comes on top of delay_s. burst: so many frames are sent at once, when the last of them was exposed.
    stall_s: the network holds frames back for up to so long and then sends them together, every stall_every_s in the
    mean. arrival_stamps: frames are stamped as they arrive, not as they are exposed. reordered_share: of the frames,
    those that the next one overtakes.
    """

    rate_hz: Positive = 100.0
    jitter_s: NotNegative = 0.0005
    noise_m: NotNegative = 0.0001
    noise_rad: NotNegative = 0.001
    delay_s: NotNegative = 0.008
    delay_jitter_s: NotNegative = 0.0005
    lost_share: Share = 0.0
    occluded_share: Share = 0.0
    burst: Annotated[int, Field(ge=1, le=1000)] = 1
    gaps: tuple[Gap, ...] = ()
    stall_s: NotNegative = 0.0
    stall_every_s: Positive = 1.0
    arrival_stamps: bool = False
    reordered_share: Share = 0.0


class MocapEmulator:
    """Exposes all bodies of a lab at the camera's rhythm and hands the frames out when they would arrive."""

    def __init__(
        self,
        config: EmulatorConfig,
        lab: LabConfig,
        leader: Playback | None,
        seed: int,
        t0_ns: int,
    ) -> None:
        """leader: the leader that no drone carries, if so."""
        n = len(lab.vehicles)
        self._config = config
        self._leader = leader
        self._rng = np.random.default_rng([seed, 1])
        self._bodies = tuple(v.body for v in lab.vehicles)
        self._sysids = tuple(v.sysid for v in lab.vehicles)
        self._q_flu_from_marker = frames.inverse(np.array([v.q_marker_from_flu for v in lab.vehicles]))
        q_mocap_from_lab = frames.inverse(np.array(lab.mocap.q_lab_from_mocap))
        self._view = np.concatenate([q_mocap_from_lab, lab.mocap.origin_lab_m])
        self._noise = np.array([config.noise_m] * 3 + [config.noise_rad] * 3)
        self._t0_ns = t0_ns
        self._ticks = 0
        self._seq = 0
        self.next_exposure_ns = t0_ns
        """When `expose` is due."""
        self._start_ns: int | None = None
        arrival = np.random.default_rng([seed, 2])
        self.cable = MemoryLink[RawFrame](
            random_delay(config.delay_s, config.delay_jitter_s, config.lost_share, arrival)
        )
        """On which its frames are under way: `pop_due` has the next at `next_due_ns`."""
        self._unsent: list[RawFrame] = []
        self._overtaken: list[RawFrame] = []
        self._orders = np.random.default_rng([seed, 4])
        self._stamped_ns = 0
        self._stalls = np.random.default_rng([seed, 3])
        self._stall_ns = self._next_stall_after(t0_ns)
        self._truth = np.zeros((n, 14))
        self._pos = np.zeros((n, 3))
        self._q = np.tile(frames.IDENTITY, (n, 1))

    @property
    def next_photo_ns(self) -> int:
        """When `expose` is best called in real time: half of its delay later the truths of its time have come."""
        return self.next_exposure_ns + round(0.5e9 * self._config.delay_s)

    @property
    def next_frame_ns(self) -> int:
        """When `pop_due` has the next frame."""
        return self.cable.next_due_ns

    def start(self, now_ns: int) -> None:
        """The formation phase begins: the recorded leader moves, the gaps' clock runs."""
        if self._start_ns is None:
            self._start_ns = now_ns

    def is_dark(self, t_ns: int) -> bool:
        """Whether there are no frames then."""
        return None in self._hidden_by_gaps(t_ns)

    def expose(self, truths: Mapping[int, Truth]) -> None:
        """Take one frame at `next_exposure_ns`; truths: by sysid, at that time or little before it."""
        t_ns, carried = self.next_exposure_ns, np.zeros(len(self._bodies), np.bool_)
        for i, sysid in enumerate(self._sysids):
            truth = truths.get(sysid) if sysid is not None else None
            if truth is None or t_ns - truth.t_ns > TRUTH_LIVES_NS:
                continue
            carried[i] = True
            row = self._truth[i]
            row[0] = (t_ns - truth.t_ns) * 1e-9
            row[1:4], row[4:7] = truth.pos_lab_m, truth.vel_lab_m_s
            row[7:11], row[11:14] = truth.q_lab_from_flu, truth.rate_flu_rad_s
        self.expose_states(self._truth, carried)

    def expose_states(self, truth: Float, carried: Bool) -> None:
        """Take one frame of true states (n, 14), as `measure_poses` has them; carried (n): which bodies have one."""
        t_ns = self.next_exposure_ns
        n = len(self._bodies)
        noise = self._rng.standard_normal((n, 6)) * self._noise
        seen: Bool = self._rng.random(n) >= self._config.occluded_share
        hidden = self._hidden_by_gaps(t_ns)
        if hidden:
            seen &= np.array([body not in hidden for body in self._bodies])
        self._measure_poses(t_ns, truth, carried, seen, noise)
        if None not in hidden:
            self._send(t_ns, RawFrame(self._seq, t_ns, self._bodies, self._pos.copy(), self._q.copy(), seen))
        self._seq += 1
        self.next_exposure_ns = self._next_exposure_after(t_ns)

    def skip_to(self, now_ns: int) -> None:
        """Skip the exposures until `now_ns`: the cameras' computer was stopped."""
        ticks = self._ticks
        self.next_exposure_ns = self._next_exposure_after(now_ns)
        self._seq += self._ticks - ticks

    def pop_due(self, now_ns: int) -> list[RawFrame]:
        """The frames that have arrived by now, oldest first."""
        due = self.cable.pop_due(now_ns)
        return (
            [self._stamped(frame, t_ns) for t_ns, frame in due] if self._config.arrival_stamps else [f for _, f in due]
        )

    def _stamped(self, frame: RawFrame, arrived_ns: int) -> RawFrame:
        self._stamped_ns = max(arrived_ns, self._stamped_ns + IN_BURST_NS)
        return replace(frame, t_capture_ns=self._stamped_ns)

    def _send(self, t_ns: int, frame: RawFrame) -> None:
        self._unsent.append(frame)
        if len(self._unsent) >= self._config.burst and not self._is_stalled(t_ns):
            for each in self._unsent:
                if not self._overtaken and self._orders.random() < self._config.reordered_share:
                    self._overtaken = [each]
                    continue
                for sent in (each, *self._overtaken):
                    self.cable.push(t_ns, sent)
                self._overtaken = []
            self._unsent = []

    def _measure_poses(self, t_ns: int, truth: Float, carried: Bool, seen: Bool, noise: Float) -> None:
        """Fill in the poses of the bodies in sight; the others keep their last pose and lose their flag in `seen`.

        A recording that plays brings its own noise along; held still, it is given the emulator's.
        """
        carried = carried & seen
        measure_poses(truth, carried, self._view, self._q_flu_from_marker, noise, self._pos, self._q)
        elapsed_ns = t_ns - (self._start_ns or t_ns)
        if self._leader is not None and seen[0] and self._leader.is_in_sight(elapsed_ns):
            pos, q = self._leader.pose(elapsed_ns)
            shown = noise[0] * (0.0 if self._start_ns is not None and self._leader.plays(elapsed_ns) else 1.0)
            blur(pos, q, self._view, self._q_flu_from_marker[0], shown, self._pos[0], self._q[0])
            carried[0] = True
        seen &= carried

    def _hidden_by_gaps(self, t_ns: int) -> set[str | None]:
        if self._start_ns is None or not self._config.gaps:
            return set()
        elapsed_s = (t_ns - self._start_ns) * 1e-9
        return {gap.body for gap in self._config.gaps if gap.at_s <= elapsed_s < gap.at_s + gap.for_s}

    def _is_stalled(self, t_ns: int) -> bool:
        if self._config.stall_s == 0.0:
            return False
        while t_ns >= self._stall_ns[1]:
            self._stall_ns = self._next_stall_after(self._stall_ns[1])
        return t_ns >= self._stall_ns[0]

    def _next_stall_after(self, t_ns: int) -> tuple[int, int]:
        """From when to when the network holds back all frames."""
        begin_ns = t_ns + round(1e9 * self._config.stall_every_s * self._stalls.standard_exponential())
        return begin_ns, begin_ns + round(1e9 * self._config.stall_s * self._stalls.random())

    def _next_exposure_after(self, t_ns: int) -> int:
        """The recorded stamp that comes next while a recording plays, else the camera's next jittered tick."""
        if self._start_ns is not None and self._leader is not None:
            recorded = self._leader.next_exposure_ns(t_ns - self._start_ns)
            if recorded is not None:
                return self._start_ns + recorded
        period = 1e9 / self._config.rate_hz
        jitter = self._config.jitter_s * 1e9 * self._rng.standard_normal()
        self._ticks = max(self._ticks, int((t_ns - self._t0_ns) / period)) + 1
        nominal = self._t0_ns + self._ticks * period
        bounded = min(max(jitter, -0.4 * period), 0.4 * period)
        return max(round(nominal + bounded), t_ns + round(0.2 * period))


@kernel
def measure_poses(
    truth: Float, in_view: Bool, view: Float, q_flu_from_marker: Float, noise: Float, pos: Float, q: Float
) -> None:
    """Poses of the bodies in view, in the mocap's axes, into pos (n, 3) and q (n, 4).

    truth (n, 14): seconds since the truth was so, pos_lab_m, vel_lab_m_s, q_lab_from_flu, rate_flu_rad_s.
    view (7): q_mocap_from_lab and the mocap's origin in lab; q_flu_from_marker (n, 4).
    noise (n, 6): m in lab, rad in flu.
    """
    from_origin, turn, moved, seen = pos[0].copy(), pos[0].copy(), q[0].copy(), q[0].copy()
    for i in range(len(in_view)):
        if not in_view[i]:
            continue
        dt = truth[i, 0]
        for axis in range(3):
            from_origin[axis] = truth[i, 1 + axis] + dt * truth[i, 4 + axis] - view[4 + axis] + noise[i, axis]
            turn[axis] = dt * truth[i, 11 + axis]
        rotate_into(view[:4], from_origin, pos[i])
        turn_into(truth[i, 7:11], turn, moved)
        turn_into(moved, noise[i, 3:], seen)
        multiply_into(view[:4], seen, moved)
        multiply_into(moved, q_flu_from_marker[i], q[i])


@kernel
def blur(
    pos_mocap_m: Float, q_mocap_from_marker: Float, view: Float, q_flu_from_marker: Float, noise: Float,
    pos: Float, q: Float,
) -> None:  # fmt: skip
    """The same noise (6) on one body whose pose the mocap's axes have already, into pos (3) and q (4)."""
    shift, q_marker_from_flu, flu, turned = pos.copy(), q.copy(), q.copy(), q.copy()
    rotate_into(view[:4], noise[:3], shift)
    q_marker_from_flu[0] = q_flu_from_marker[0]
    for axis in range(3):
        pos[axis] = pos_mocap_m[axis] + shift[axis]
        q_marker_from_flu[axis + 1] = -q_flu_from_marker[axis + 1]
    multiply_into(q_mocap_from_marker, q_marker_from_flu, flu)
    turn_into(flu, noise[3:], turned)
    multiply_into(turned, q_flu_from_marker, q)
