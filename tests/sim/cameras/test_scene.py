"""Rooms without drones: what a camera system in a box shows."""

import numpy as np
import pytest

from formation.messages import RawFrame
from formation.mocap_config import MocapConfig
from sim.cameras.emulator import EmulatorConfig
from sim.cameras.scene import CirclingScene, lab_of

S = 1_000_000_000
EXACT = EmulatorConfig(jitter_s=0.0, noise_m=0.0, noise_rad=0.0, delay_s=0.0, delay_jitter_s=0.0)
Y_UP = MocapConfig.model_validate({"axes": ["x right", "y up", "z back"], "origin_lab_m": [0.3, -0.2, 0.1]})


def shown(room: CirclingScene, for_s: float) -> list[RawFrame]:
    found: list[RawFrame] = []
    while room.next_ns <= for_s * S:
        found += room.frames(room.next_ns)
    return found


def test_a_still_room_is_still_and_turned_cameras_show_it_in_their_own_axes() -> None:
    plain = shown(CirclingScene(lab_of(("a", "b"), MocapConfig()), EXACT, True, None, 1, 0), 0.5)
    turned = shown(CirclingScene(lab_of(("a", "b"), Y_UP), EXACT, True, None, 1, 0), 0.5)
    np.testing.assert_allclose(plain[-1].pos_mocap_m, plain[0].pos_mocap_m, atol=1e-12)
    # The cameras' x points to the right (the lab's -y), y up, z back (-x).
    x, y, z = plain[0].pos_mocap_m.T
    np.testing.assert_allclose(turned[0].pos_mocap_m, np.array([-(y + 0.2), z - 0.1, -(x - 0.3)]).T, atol=1e-12)


def test_a_burst_comes_at_once_and_every_frame_of_it_with_its_own_exposure() -> None:
    cameras = EXACT.model_copy(update={"burst": 10})
    room = CirclingScene(lab_of(("a", "b"), MocapConfig()), cameras, False, None, 1, 0)
    came: list[tuple[int, int]] = []
    while room.next_ns <= S:
        now_ns = room.next_ns
        came += [(now_ns, frame.t_capture_ns) for frame in room.frames(now_ns)]
    assert len(came) == 100
    arrivals, exposures = np.array(came).T
    assert len(set(arrivals.tolist())) == 10
    assert np.diff(exposures) == pytest.approx(10_000_000)
    assert (arrivals - exposures).max() == pytest.approx(90_000_000)


def test_a_box_that_was_stopped_does_not_keep_its_clients_waiting_for_what_it_missed() -> None:
    room = CirclingScene(lab_of(("a", "b"), MocapConfig()), EXACT, False, None, 1, 0)
    before = shown(room, 1.0)
    assert room.frames(6 * S) == []
    assert 6 * S < room.next_ns <= 6 * S + S // 100
    after = shown(room, 7.0)
    assert len(after) in (99, 100, 101)
    assert after[0].seq - before[-1].seq == round((after[0].t_capture_ns - before[-1].t_capture_ns) / (S // 100))
