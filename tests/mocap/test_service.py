"""The mocap process as a process: started where none serves, started again when killed, outliving its ground."""

import asyncio
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from unittest.mock import AsyncMock, Mock

import numpy as np
import pytest

from formation.messages import Event, LabFrame, RawFrame
from mocap import service
from mocap.service import ServiceError, configuration_name, mocap_service
from tests.gcs.bus import a_lab, hub_of
from tests.wire.waiting import in_loop
from wire import clock
from wire.config_file import dump
from wire.transport.mocap_bus import MocapBus

pytestmark = pytest.mark.processes


async def eventually(wanted: Callable[[], bool]) -> None:
    while not wanted():
        await asyncio.sleep(0.02)


async def show(bus: MocapBus) -> None:
    """Be the cameras, for ever."""
    for seq in range(10**9):
        q = np.tile([1.0, 0, 0, 0], (2, 1))
        bus.publish_raw(RawFrame(seq, clock.monotonic_ns(), ("left", "lead"), np.zeros((2, 3)), q, np.ones(2, bool)))
        await asyncio.sleep(0.01)


def mocap_pids(file: Path) -> list[int]:
    """The processes that were started as `gcs mocap FILE`."""
    found = []
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                words = (entry / "cmdline").read_bytes().decode(errors="replace").split("\0")
            except OSError:
                continue
            if "mocap" in words and str(file) in words:
                found.append(int(entry.name))
    return found


@in_loop
async def test_one_is_started_serves_aligned_frames_comes_back_when_killed_and_ends_with_us(tmp_path):
    config, file = a_lab(), tmp_path / "lab.toml"
    file.write_text(dump(config))
    bus = await hub_of(config)
    mocap, events, frames = MocapBus(bus), [], []
    mocap.on_frame(frames.append)
    cameras = asyncio.create_task(show(mocap))
    async with mocap_service(config, file, mocap, events.append):
        await eventually(lambda: bool(frames))
        assert isinstance(frames[0], LabFrame)
        assert frames[0].bodies == ("lead", "left")
        assert frames[0].pos_lab_m.tolist() == [[1, 0, 0], [1, 0, 0]]
        assert 0 <= frames[0].t_receive_ns - frames[0].t_capture_ns < 1_000_000_000
        (pid,) = mocap_pids(file)
        os.kill(pid, signal.SIGKILL)
        await eventually(lambda: any("signal 9" in event.text for event in events))
        frames.clear()
        await eventually(lambda: bool(frames))
    assert mocap_pids(file) == []
    cameras.cancel()
    await bus.close()


@in_loop
async def test_a_process_that_serves_other_axes_is_rejected_and_one_that_serves_these_is_used():
    config = a_lab()
    turned = config.model_copy(update={"mocap": config.mocap.model_copy(update={"q_lab_from_mocap": (0, 0, 0, 1)})})
    bus = await hub_of(config)
    MocapBus(bus).announce(configuration_name(config))
    events: list[Event] = []
    async with mocap_service(config, Path("unused.toml"), MocapBus(bus), events.append):
        pass
    assert [event.text for event in events] == ["frames come from the mocap process that is running"]
    with pytest.raises(ServiceError, match="other bodies or axes"):
        async with mocap_service(turned, Path("unused.toml"), MocapBus(bus), events.append):
            pass
    await bus.close()


@in_loop
async def test_a_process_that_ends_well_and_serves_nobody_is_no_success():
    own = service._OwnProcess(Path("unused.toml"), Mock(serving=AsyncMock(return_value=None)), print, Mock(), "gcs")
    own._process = Mock(returncode=0)
    with pytest.raises(ServiceError) as raised:
        await own.until_serving()
    assert raised.value.code == 1


@in_loop
async def test_a_restart_that_the_system_refuses_is_reported_and_tried_again(monkeypatch):
    """Without memory or processes for a moment, as when a log fills the disk: the drones' poses must come back."""
    monkeypatch.setattr(service, "AGAIN_S", 0.0)
    events: list[Event] = []
    own = service._OwnProcess(
        Path("unused.toml"), Mock(serving=AsyncMock(return_value=None)), events.append, Mock(), "gcs"
    )
    own._process = Mock(wait=AsyncMock(side_effect=[-9, service.NOT_RIGHT]))
    own.start = AsyncMock(side_effect=[OSError(12, "Cannot allocate memory"), OSError(11, "Try again"), None])
    await own.supervise()
    assert own.start.await_count == 3
    assert [event.text for event in events] == [
        "the mocap process ended (signal 9)",
        "the mocap process cannot be started (Cannot allocate memory): trying again",
        "the mocap process cannot be started (Try again): trying again",
        f"the mocap process ended (exit code {service.NOT_RIGHT})",
    ]


@in_loop
async def test_killing_the_ground_leaves_the_drones_their_poses(tmp_path):
    config, file = a_lab(), tmp_path / "lab.toml"
    file.write_text(dump(config))
    bus = await hub_of(config)
    mocap, frames = MocapBus(bus), []
    mocap.on_frame(frames.append)
    cameras = asyncio.create_task(show(mocap))
    command = [sys.executable, "-m", "gcs", "run", str(file), "--log", str(tmp_path / "flight.mcap")]
    with subprocess.Popen(command) as ground:
        await eventually(lambda: bool(frames))
        ground.kill()
    await asyncio.sleep(0.2)
    frames.clear()
    await eventually(lambda: len(frames) > 20)
    (pid,) = mocap_pids(file)
    os.kill(pid, signal.SIGTERM)
    await eventually(lambda: mocap_pids(file) == [])
    cameras.cancel()
    await bus.close()
