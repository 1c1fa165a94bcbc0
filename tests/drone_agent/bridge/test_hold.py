"""The bridge's hold: whether its body stands or is at rest, told from poses alone where there is no IMU."""

from collections.abc import Callable
from math import nan

import numpy as np
import pytest

from drone_agent.bridge.estimate import BodyEstimate
from drone_agent.bridge.hold import BridgeHold
from formation.vehicle.profile import PROFILES
from tests.drone_agent.agent_harness import LEVEL, MS
from wire.link_messages.motion import AttitudeQuaternion

NOISES_M = (3e-4, 1e-3)
"""Of poses, per axis: emulated cameras, and the coarsest that the navigator is tested with."""


class Body:
    """Poses at 100 Hz, ATTITUDE_QUATERNION at 50 Hz and no HIGHRES_IMU, of a body that moves along x or z."""

    def __init__(self, noise_m: float) -> None:
        self.estimate = BodyEstimate(PROFILES["px4_quad"], 1)
        self.hold = BridgeHold(self.estimate)
        self._noise_m, self._rng = noise_m, np.random.default_rng(3)
        self._k = 0

    def run(self, seconds: float, velocity_m_s: tuple[float, float], each: Callable[[int], None]) -> None:
        """velocity_m_s: along x and z; each: called with the time after every pose."""
        start = self._k
        while self._k < start + round(100 * seconds):
            self._k += 1
            now_ns, moved_s = self._k * 10 * MS, 0.01 * (self._k - start)
            if self._k % 2 == 0:
                self.estimate.receive_attitude(now_ns, AttitudeQuaternion(now_ns // MS, LEVEL, np.zeros(3)))
            self.estimate.receive_command(now_ns, nan)  # as on the floor, or where nobody knows
            place = np.array([velocity_m_s[0] * moved_s, 0.0, 1.0 + velocity_m_s[1] * moved_s])
            pos = place + self._noise_m * self._rng.standard_normal(3)
            self.estimate.receive_pose(now_ns - 8 * MS, pos, LEVEL, stands=True)
            each(now_ns)


def _seconds_let_down(noise_m: float, sink_m_s: float) -> float | None:
    """How long a body that sinks so fast is let down until it counts as standing; None: it does not within 3 s."""
    body = Body(noise_m)
    body.run(5.0, (0.0, 0.0), lambda _: None)
    stood_ns: list[int] = []

    def step(now_ns: int) -> None:
        body.hold.step(now_ns, 0.01, down=True)
        if body.hold.stands:
            stood_ns.append(now_ns)

    body.hold.begin(5_000 * MS)
    body.run(3.0, (0.0, -sink_m_s), step)
    return stood_ns[0] * 1e-9 - 5.0 if stood_ns else None


@pytest.mark.parametrize("noise_m", NOISES_M)
def test_a_body_on_the_floor_stands_within_a_second_without_an_imu(noise_m: float) -> None:
    """Its velocity alone, which is noise there, kept PX4's motors at 85 % on the floor for ever."""
    stood_s = _seconds_let_down(noise_m, 0.0)
    assert stood_s is not None
    assert stood_s < 1.0


@pytest.mark.parametrize("noise_m", NOISES_M)
def test_a_body_that_sinks_does_not_stand(noise_m: float) -> None:
    assert _seconds_let_down(noise_m, 0.2) is None


@pytest.mark.parametrize("noise_m", NOISES_M)
@pytest.mark.parametrize(("speed_m_s", "rests"), [(0.0, True), (0.1, False)])
def test_rest_is_told_by_the_place(noise_m: float, speed_m_s: float, rests: bool) -> None:
    """A stop is over after two seconds of it."""
    body, longest, since_ns = Body(noise_m), 0, 0
    body.run(2.0, (0.0, 0.0), lambda _: None)

    def look(now_ns: int) -> None:
        nonlocal longest, since_ns
        if not body.hold.update_rest(now_ns, armed=True):
            since_ns = now_ns
        longest = max(longest, now_ns - since_ns)

    since_ns = 2_000 * MS
    body.run(4.0, (speed_m_s, 0.0), look)
    assert (longest >= 2_000 * MS) is rests
