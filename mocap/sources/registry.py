"""The source that a lab file names: a camera system, raw frames on the lab's bus, or a leader's recording."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from formation.config import LabConfig
from formation.messages import RawFrame, Severity
from formation.mocap_config import QualisysConfig, ViconConfig
from mocap.sources.csv_file import read_recording
from mocap.sources.source import Feed, Source, SourceStatus
from wire.transport.mocap_bus import MocapBus


class BusSource:
    """Whoever publishes. Its stamps are on our clock already, or 0."""

    def __init__(self, bus: MocapBus, feed: Feed) -> None:
        self._bus = bus
        self._deliver = feed.deliver
        self._status = SourceStatus(server="the lab's bus")

    async def run(self) -> None:
        """Take what comes."""
        self._bus.on_raw(self._receive)
        await asyncio.get_running_loop().create_future()

    def status(self) -> SourceStatus:
        """Connected when a frame has come."""
        return self._status

    def _receive(self, frame: RawFrame) -> None:
        if frame.bodies != self._status.bodies:
            self._status = SourceStatus(self._status.server, connected=True, bodies=frame.bodies)
        self._deliver(frame)


class Recording:
    """A leader's recorded poses in real time, once somebody listens; MocapFileError for a file that cannot be used."""

    def __init__(self, config: LabConfig, has_listener: Callable[[], bool], feed: Feed) -> None:
        path, bodies, seen = Path(config.mocap.file or ""), (config.leader.body,), np.ones(1, np.bool_)
        recorded = read_recording(path, config.leader.body, config.mocap.unit_m)
        poses = zip(recorded.t_ns.tolist(), recorded.pos_mocap_m, recorded.q_mocap_from_marker, strict=True)
        self._frames = [RawFrame(i, t_ns, bodies, pos[None], q[None], seen) for i, (t_ns, pos, q) in enumerate(poses)]
        self._delay_ns = round(config.mocap.delay_s * 1e9)
        self._has_listener = has_listener
        self._feed = feed
        self._status = SourceStatus(server=str(path), bodies=bodies)

    async def run(self) -> None:
        """Each frame `delay_s` after its own time since the first, captures restamped to now; then nothing more."""
        clock = self._feed.clock
        while not self._has_listener():
            await clock.sleep_until_ns(clock.monotonic_ns() + 100_000_000)
        self._status = replace(self._status, connected=True)
        start_ns = clock.monotonic_ns()
        for frame in self._frames:
            t_ns = start_ns + frame.t_capture_ns
            await clock.sleep_until_ns(t_ns + self._delay_ns)
            self._feed.deliver(replace(frame, t_capture_ns=t_ns))
        self._status = replace(self._status, connected=False)
        self._feed.report(Severity.WARNING, "the recording is over")
        await asyncio.get_running_loop().create_future()

    def status(self) -> SourceStatus:
        """Whether it plays."""
        return self._status


def open_source(config: LabConfig, bus: MocapBus, feed: Feed) -> Source:
    """The source that `[mocap] source` names; nothing is reached before it is run.

    Raises MocapFileError for a file that cannot be used.
    """
    lab = tuple(v.body for v in config.vehicles)
    latency_ns = round(1e9 * config.mocap.constant_latency_s)
    match config.mocap.source:
        case "zenoh":
            return BusSource(bus, feed)
        case "csv":
            return Recording(config, lambda: bus.has_subscribers, feed)
        case "vrpn" | "nokov":
            from mocap.sources.vrpn.session import vrpn_source

            return vrpn_source(config, feed)
        case "chingmu":
            from mocap.sources.vrpn.session import chingmu_source

            return chingmu_source(config, feed)
        case "natnet":
            from mocap.sources.natnet.session import NatNet

            return NatNet(config, feed)
        case "qualisys":
            from mocap.sources.qualisys import Qualisys

            return Qualisys(config.mocap.qualisys or QualisysConfig(), lab, latency_ns, feed)
        case "vicon":
            from mocap.sources.vicon import Vicon

            return Vicon(config.mocap.vicon or ViconConfig(), lab, latency_ns, feed)
        case "ros2":
            from mocap.sources.ros2 import Ros2Source

            return Ros2Source(config, feed)
