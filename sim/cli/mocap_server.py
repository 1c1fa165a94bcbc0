"""The work of `gcs-sim mocap-server`: the lab or the bodies that were asked for, and the vendor's server."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pydantic import ValidationError

from formation.config import LabConfig
from formation.mocap_config import MocapConfig
from mocap.sources.csv_file import MocapFileError, read_recording
from sim.cameras.emulator import EmulatorConfig
from sim.cameras.playback import Playback
from sim.cameras.scene import CirclingScene, lab_of
from sim.cameras.systems import LOOPBACK, OTHER_LOOPBACK, SOURCE_OF, is_camera_system, server_for
from sim.cli.app import BoxOptions
from wire.clock import Clock
from wire.config_file import load
from wire.errors import ConfigError

BODIES = ("body1", "body2", "body3")
"""Without a lab file."""
AWAY_NS = 1_000_000_000
"""How long a restarted server is away."""


class BoxError(ValueError):
    """Something given cannot be served, in one line."""


@dataclass(frozen=True, slots=True)
class Box:
    """A scene, the camera system that sees it, and their clock."""

    scene: CirclingScene
    mocap: MocapConfig
    clock: Clock

    async def serve(self, restart_every_s: float | None, report: Callable[[str], None]) -> None:
        """Serve until cancelled, restarting the server so often, if given; OSError where an address is taken."""
        table = getattr(self.mocap, self.mocap.source)
        where = ", ".join(f"{key} {value}" for key, value in table.model_dump(exclude_none=True).items())
        report(f"{self.mocap.source} ({where}): {', '.join(self.scene.bodies)}")
        server = server_for(self.mocap, self.scene.bodies, self.clock)
        await server.start()
        start_ns, restarts = self.clock.monotonic_ns(), 0
        try:
            while True:
                await asyncio.sleep(0.0)  # also where the time has passed: clients are to be let in
                await self.clock.sleep_until_ns(self.scene.next_ns)
                now_ns = self.clock.monotonic_ns()
                if restart_every_s is not None and now_ns - start_ns >= (restarts + 1) * restart_every_s * 1e9:
                    restarts += 1
                    report("the server goes")
                    await server.close()
                    await self.clock.sleep_until_ns(now_ns + AWAY_NS)
                    self.scene.frames(self.clock.monotonic_ns())  # the frames of that time are lost
                    server = server_for(self.mocap, self.scene.bodies, self.clock)
                    await server.start()
                    report("the server is back")
                for frame in self.scene.frames(self.clock.monotonic_ns()):
                    server.publish(frame)
        finally:
            await server.close()


def box(options: BoxOptions) -> Box:
    """Raises BoxError for what cannot be served."""
    clock = Clock(options.speed)
    t0_ns = clock.monotonic_ns()
    try:
        leader = None if options.csv is None else Playback(read_recording(options.csv))
        lab = lab_of(BODIES, MocapConfig()) if options.lab is None else load(options.lab, LabConfig)
        mocap = _mocap(lab.mocap, options)
        emulator = EmulatorConfig.model_validate({"rate_hz": mocap.rate_hz} | _settings(options.cameras))
    except (ConfigError, MocapFileError, ValidationError) as error:
        raise BoxError(_first_line(error)) from error
    lab = lab.model_copy(update={"mocap": mocap})
    return Box(CirclingScene(lab, emulator, options.still, leader, options.seed, t0_ns), mocap, clock)


def _mocap(mocap: MocapConfig, options: BoxOptions) -> MocapConfig:
    """The lab's own section with the protocol and the address given."""
    source = mocap.source if options.protocol is None else SOURCE_OF[options.protocol]
    values = mocap.model_dump(exclude_none=True) | {"source": source}
    if not is_camera_system(MocapConfig.model_validate(values)):
        raise BoxError(f'source "{source}" is no camera system: --protocol {"|".join(SOURCE_OF)}')
    host, port = options.host, options.port
    table = values.get(source, {})
    table["host"] = host or table.get("host") or (OTHER_LOOPBACK if source == "natnet" else LOOPBACK)
    if port is not None:
        table |= {"command_port": port, "data_port": port + 1} if source == "natnet" else {"port": port}
    return MocapConfig.model_validate(values | {source: table})


def _settings(text: str) -> dict[str, Any]:
    """KEY=VALUE pairs."""
    settings = {}
    for pair in filter(None, text.split(",")):
        key, found, value = pair.partition("=")
        if not found:
            raise BoxError(f"--cameras: {pair!r} is not KEY=VALUE")
        settings[key.strip()] = value.strip()
    return settings


def _first_line(error: Exception) -> str:
    if isinstance(error, ValidationError):
        first = error.errors()[0]
        return f"--cameras: {'.'.join(map(str, first['loc']))}: {first['msg']}"
    return str(error)
