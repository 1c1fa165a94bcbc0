"""The example that plays the cameras of simulated autopilots, against our own simulated drone and pymavlink."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from formation.config import LabConfig
from formation.messages import Datagram, RawFrame
from tests.drone_agent.agent_harness import MS, Harness
from wire.transport.frame_check import raw_fault

EXAMPLE = SimpleNamespace(**runpy.run_path(str(Path(__file__).parents[2] / "examples" / "sitl_poses.py"), run_name=""))
START_LAB_M = (0.3, -0.2, 0.0)


def _lab() -> LabConfig:
    return LabConfig.model_validate(
        {
            "mocap": {"rate_hz": 50.0},
            "leader": {"body": "lead", "sysid": 1, "spawn_lab_m": START_LAB_M},
            "followers": [{"body": "left", "sysid": 2, "offset_m": (0, 1, 0), "spawn_lab_m": (0.0, 1.5, 0.0)}],
        }
    )


class _Sitl(Harness):
    """A simulated drone whose packets the example reads."""

    def __init__(self, sysid: int, frames) -> None:
        super().__init__(sysid=sysid, start_lab_m=START_LAB_M, start_yaw_rad=0.7)
        self.frames, self.published, self.parser = frames, [], common.MAVLink(None)

    def tick(self) -> None:
        for datagram in self.core.tick(self.now_ns).datagrams:
            self.heard += [(self.now_ns, packet.message) for packet in self.codec.receive(datagram.data)]
            for message in self.parser.parse_buffer(datagram.data) or ():
                self.frames.states["lead"].receive(message, self.now_ns)
        if (frame := self.frames.due(self.now_ns)) is not None:
            assert raw_fault(frame, self.now_ns) is None
            self.published.append((frame, self.truth))


def _asked(sysid: int, period_ns: int) -> bytes:
    asked = []
    mav = common.MAVLink(SimpleNamespace(write=asked.append), srcSystem=254)
    EXAMPLE.ask(mav, sysid, period_ns)
    return b"".join(asked)


def test_publishes_the_true_pose_of_a_drone_that_takes_off() -> None:
    frames = EXAMPLE.Frames(_lab())
    drone = _Sitl(1, frames)
    drone.core.receive(Datagram(1, _asked(1, frames.period_ns)), 0)
    drone.run(3.0)
    drone.command(400, 1.0)
    drone.command(22, 0, 0, 0, np.nan, np.nan, np.nan, np.nan)
    drone.run(6.0)
    assert len(drone.published) == pytest.approx(450, abs=10)
    assert drone.truth.pos_lab_m[2] > 2.0
    for frame, truth in drone.published:
        assert (frame.bodies, frame.seen.tolist()) == (("lead", "left"), [True, False])
        np.testing.assert_allclose(frame.pos_mocap_m[0], truth.pos_lab_m, atol=0.02)
        assert abs(frame.q_mocap_from_marker[0] @ truth.q_lab_from_flu) > 1.0 - 1e-6
    steps = np.diff([frame.pos_mocap_m[0] for frame, _ in drone.published[-100:]], axis=0)
    assert np.abs(steps).max() < 0.002  # hovering, though latitude comes in steps of 11 mm


def _unstamped(north_m: float) -> object:
    """HIL_STATE_QUATERNION as PX4 v1.17's SIH sends it: without a time."""
    lat = 473977420 + round(np.degrees(north_m / 6_378_137.0) * 1e7)
    mav = common.MAVLink(None, srcSystem=1)
    fields = ([1.0, 0.0, 0.0, 0.0], 0, 0, 0, lat, 85455940, 488_000 + round(500 * north_m), 100, 0, -50, 0, 0, 0, 0, 0)
    return mav.parse_buffer(mav.hil_state_quaternion_encode(0, *fields).pack(mav))[0]


def _sim_state(north_m: float) -> object:
    lat = 473977420 + round(np.degrees(north_m / 6_378_137.0) * 1e7)
    values = (1, *[0] * 12, 0.0, 0.0, 488.0 + 0.5 * north_m, 0, 0, 1.0, 0.0, -0.5)
    mav = common.MAVLink(None, srcSystem=2)
    return mav.parse_buffer(mav.sim_state_encode(*values, lat_int=lat, lon_int=85455940).pack(mav))[0]


@pytest.mark.parametrize("say", [_unstamped, _sim_state])
def test_frames_go_on_without_a_drone_that_falls_silent_and_its_last_pose_is_carried_on_until_then(say) -> None:
    frames = EXAMPLE.Frames(_lab())
    published: list[RawFrame] = []
    for ms in range(0, 1000, 20):
        for state in frames.states.values() if ms < 500 else (frames.states["left"],):
            state.receive(say(1e-3 * ms), ms * MS)
        for now_ms in (ms, ms + 10):
            if (frame := frames.due(now_ms * MS)) is not None:
                published.append(frame)
    assert [frame.seq for frame in published] == list(range(1, len(published) + 1))
    assert published[-1].seen.tolist() == [False, True]
    assert published[0].seen.all()
    np.testing.assert_allclose(published[-1].pos_mocap_m[1], [0.98, 1.5, 0.49], atol=0.012)
    late = next(frame for frame in published if frame.t_capture_ns >= 500 * MS)
    np.testing.assert_allclose(late.pos_mocap_m[0], [0.3 + late.t_capture_ns * 1e-9, -0.2, 0.25], atol=0.02)
