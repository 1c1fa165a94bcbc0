"""The daemon in this process: a recorded leader as its mocap, a bus of its own, no drone that answers."""

import asyncio
import os
import signal
import socket
from itertools import pairwise
from pathlib import Path

import pytest

from formation import topics
from formation.config import LabConfig
from formation.messages import Event, Phase
from gcs.core import BrokenInvariantError, GcsCore
from gcs.daemon import Ended, GroundFailure, run
from gcs.mocap.csv_file import MocapFileError
from gcs.replay import replay
from wire.mcap_log import check_log, read_log

FRAMES = 400


def _lab(tmp_path: Path) -> LabConfig:
    csv = tmp_path / "leader.csv"
    csv.write_text("".join(f"{i * 5_000_000},{0.001 * i},0,1,1,0,0,0\n" for i in range(FRAMES)))
    return LabConfig.model_validate(
        {
            "name": f"test-{os.getpid()}",
            "mocap": {"source": "csv", "file": str(csv), "rate_hz": 200.0, "delay_s": 0.0},
            "leader": {"body": "lead"},
            "followers": [{"body": "left", "sysid": 2, "offset_m": (0, 1, 0)}],
            "link": {"zenoh_connect": ()},
        }
    )


def _signal_after(seconds: float, number: int) -> None:
    asyncio.get_running_loop().call_later(seconds, os.kill, os.getpid(), number)


async def _run_for(seconds: float, config: LabConfig, log: Path, told: list[Event]) -> Ended:
    _signal_after(seconds, signal.SIGINT)
    return await run(config, log, "main", {"scenario": "test"}, told.append)


def test_frames_are_flown_recorded_and_replayed_bit_by_bit(tmp_path):
    log = tmp_path / "flight.mcap"
    ended = asyncio.run(_run_for(1.0, _lab(tmp_path), log, []))
    assert ended.phase is Phase.GROUND
    assert ended.lost_records == 0
    held = check_log(log)
    assert held.complete
    assert 20 <= held.entries["mocap/frame"] <= FRAMES
    assert held.entries["mocap/frame"] == held.entries["control/target"] == ended.timing.ticks
    assert read_log(log).metadata["scenario"] == "test"
    assert replay(read_log(log)).identical


def test_latency_is_recorded_for_every_frame(tmp_path):
    log = tmp_path / "flight.mcap"
    asyncio.run(_run_for(0.5, _lab(tmp_path), log, []))
    entries = list(read_log(log).entries)
    timings = [e.message for e in entries if e.topic is topics.TIMING]
    frames = [e.message.seq for e in entries if e.topic is topics.MOCAP]
    assert [timing.frame_seq for timing in timings] == frames
    assert all(0.0 < timing.latency_s < 1.0 for timing in timings)


def test_a_core_that_breaks_ends_the_daemon_with_its_reason_and_a_whole_log(tmp_path, monkeypatch):
    whole_tick, log = GcsCore.tick, tmp_path / "flight.mcap"

    def tick(core: GcsCore, now_ns: int):
        outgoing = whole_tick(core, now_ns)
        if core._lateness.frames > 20:
            raise BrokenInvariantError("the estimate is not finite")
        return outgoing

    monkeypatch.setattr(GcsCore, "tick", tick)
    with pytest.raises(GroundFailure, match="BrokenInvariantError: the estimate is not finite"):
        asyncio.run(run(_lab(tmp_path), log, "main", {}, lambda _event: None))
    assert check_log(log).complete


def test_a_recording_that_is_not_right_ends_the_daemon_with_file_and_line(tmp_path):
    config = _lab(tmp_path)
    (tmp_path / "leader.csv").write_text("1,0,0,0,1,0,0,0\n0,0,0,0,1,0,0,0\n")
    with pytest.raises(MocapFileError, match=r"leader\.csv:2: time goes back"):
        asyncio.run(run(config, tmp_path / "flight.mcap", "main", {}, lambda _event: None))


def test_a_port_that_is_taken_is_named(tmp_path):
    config = _lab(tmp_path)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        link = config.link.model_copy(update={"kind": "udp", "ground_port_base": port - 2})
        config = config.model_copy(update={"link": link})
        with pytest.raises(OSError, match=f"UDP ports {port} on 127.0.0.1: Address already in use"):
            asyncio.run(run(config, tmp_path / "flight.mcap", "main", {}, lambda _event: None))


STRAYS = (b"\xfe" * 1500, b"\xfd" * 1500, bytes(60_000), b"no MAVLink", b"\xfd\xff\x02" * 500)


async def _stray(ports: list[int], pause_s: float) -> None:
    """Throw strays at the ports, each kind in turn; for ever."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        while True:
            for port in ports:
                for stray in STRAYS:
                    stranger.sendto(stray, ("127.0.0.1", port))
            await asyncio.sleep(pause_s)


def test_strays_cost_no_frame_are_not_recorded_and_are_told_of_once_a_second(tmp_path):
    """640 a second cost six of ten frames: each was searched byte by byte, and logged."""
    base = 20_000 + os.getpid() % 10_000
    link = {"kind": "udp", "zenoh_connect": (), "ground_port_base": base, "drone_port_base": base + 10_000}
    config = LabConfig.model_validate({**_lab(tmp_path).model_dump(), "link": link})
    log, told = tmp_path / "flight.mcap", []

    async def flooded() -> Ended:
        flood = asyncio.create_task(_stray([base + 2], 0.0025))
        try:
            return await _run_for(2.0, config, log, told)
        finally:
            flood.cancel()

    ended = asyncio.run(flooded())
    held = check_log(log)
    assert held.complete
    assert held.entries["mocap/frame"] == held.entries["control/target"] == ended.timing.ticks
    assert "link/up" not in held.entries
    entries = list(read_log(log).entries)
    frames = [entry.message.seq for entry in entries if entry.topic is topics.MOCAP]
    assert frames == list(range(frames[0], frames[0] + len(frames)))
    refused = [entry for entry in entries if entry.topic is topics.REFUSED]
    assert {entry.message.source for entry in refused} == {"127.0.0.1"}
    assert all(b.t_ns - a.t_ns >= 1_000_000_000 for a, b in pairwise(refused))
    assert [event for event in told if event.source == "127.0.0.1"] == [entry.message for entry in refused]
    assert replay(read_log(log)).identical
