"""One drone as MAVSDK sees it: a connection of its own over a loopback socket, beside the ground's own link."""

import asyncio
import os
import socket
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.log_files import LogFilesAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.logging import log_subscribe
from mavsdk.plugins.info import InfoError
from mavsdk.plugins.log_files import LogFilesError
from mavsdk.plugins.param import ParamError, ParamResult

from wire.files import finish_log, inside
from wire.security.bus_access import free_loopback_port
from wire.text import plain

LOOPBACK = "127.0.0.1"
DISCOVERY_S, HEALTH_S, LISTING_S = 10.0, 5.0, 20.0


class DroneError(RuntimeError):
    """A drone that does not give what it was asked for, in words."""


class MavsdkPort:
    """A loopback socket that hands a drone's bytes to MAVSDK, and MAVSDK's bytes on; OSError if none can be had."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._loop = asyncio.get_running_loop()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind((LOOPBACK, 0))
        self._mavsdk = (LOOPBACK, free_loopback_port(socket.SOCK_DGRAM))
        self._loop.add_reader(self._socket, self._read)

    @property
    def url(self) -> str:
        """Where MAVSDK is to listen."""
        return f"udpin://{LOOPBACK}:{self._mavsdk[1]}"

    def hand_over(self, data: bytes) -> None:
        """Bytes of the drone, for MAVSDK."""
        try:
            self._socket.sendto(data, self._mavsdk)
        except OSError:  # it does not listen yet
            return

    def close(self) -> None:
        """Stop."""
        self._loop.remove_reader(self._socket)
        self._socket.close()

    def _read(self) -> None:
        while True:
            try:
                self._send(self._socket.recv(65536))
            except BlockingIOError:
                return
            except OSError:  # an ICMP answer to something sent earlier
                continue


@dataclass(frozen=True, slots=True)
class MavsdkReport:
    """One drone as MAVSDK read it; unhealthy: what it lacks, None if it did not report its health."""

    version: str
    unhealthy: tuple[str, ...] | None
    parameters: dict[str, float]


@asynccontextmanager
async def mavsdk_system(url: str) -> AsyncIterator[Any]:
    """The drone behind `url`, or None if no autopilot is found there; MAVSDK's own log is kept off the terminal."""
    log_subscribe(lambda *_: True)
    async with Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION)) as mavsdk:
        await mavsdk.add_any_connection(url)
        yield await mavsdk.first_autopilot(timeout_s=DISCOVERY_S)


async def interview(system: Any, parameters: Iterable[str]) -> MavsdkReport:
    """Ask one drone for its version, its health, and these parameters."""
    values = {name: value for name in parameters if (value := await read_parameter(system, name)) is not None}
    return MavsdkReport(await _version(system), await _unhealthy(system), values)


async def read_parameter(system: Any, name: str) -> float | None:
    """A parameter of either type; None if the drone does not have it, or does not answer."""
    found = await _typed_parameter(ParamAsync(system), name)
    return None if found is None else float(found)


async def write_parameter(system: Any, name: str, value: float) -> bool:
    """Write a parameter as the type it has, and read it back; whether it is now what was written.

    The type is asked for first: PX4 v1.16 gives no answer to a float that is set as an integer.
    """
    writer = ParamAsync(system)
    before = await _typed_parameter(writer, name)
    if before is None:
        return False
    try:
        if isinstance(before, int):
            await writer.set_param_int(name, round(value))
        else:
            await writer.set_param_float(name, value)
    except ParamError:
        return False
    found = await read_parameter(system, name)
    return found is not None and abs(found - value) < 1e-3


async def _typed_parameter(reader: ParamAsync, name: str) -> int | float | None:
    """Its value, an int or a float as it is on the drone; None as `read_parameter` has it."""
    try:
        return int(await reader.get_param_int(name))
    except ParamError as error:
        if error.result is not ParamResult.WRONG_TYPE:
            return None
    try:
        return float(await reader.get_param_float(name))
    except ParamError:
        return None


async def fetch_log(system: Any, folder: Path, prefix: str, progress: Callable[[str], None]) -> None:
    """Download the newest log, if there is one; progress: called with its file. DroneError without a list of logs."""
    files = LogFilesAsync(system)
    try:
        async with asyncio.timeout(LISTING_S):
            entries = await files.get_entries()
    except LogFilesError as error:
        raise DroneError(f"{prefix}: {error.result.name.lower().replace('_', ' ')}") from error
    except TimeoutError as error:
        raise DroneError(f"{prefix}: no list of logs came") from error
    if not entries:
        return
    entry = max(entries, key=lambda entry: int(entry.id))
    wanted = log_path(folder, prefix, entry.id, entry.date)
    progress(f"{wanted} ({entry.size_bytes / 1e6:.1f} MB)")
    own = wanted.with_name(f".{wanted.name}.{os.getpid()}")  # until it is whole
    try:
        async for _ in files.download_log_file(entry, str(own)):
            pass
    except LogFilesError as error:
        raise DroneError(f"{wanted}: {error}") from error
    own.chmod(0o600)
    finish_log(own, wanted)


def log_path(folder: Path, prefix: str, number: int, date: str) -> Path:
    """Where a drone's log goes; its date is the drone's own word, and stays inside the folder."""
    return inside(folder, f"{prefix}-{number}-{plain(date, 30).replace(':', '')}.log")


async def _version(system: Any) -> str:
    try:
        version = await InfoAsync(system).get_version()
    except InfoError:
        return ""
    return f"{version.flight_sw_major}.{version.flight_sw_minor}.{version.flight_sw_patch}"


async def _unhealthy(system: Any) -> tuple[str, ...] | None:
    values = TelemetryAsync(system).subscribe_health()
    health = None
    try:
        async with asyncio.timeout(HEALTH_S):
            async for health in values:  # the first ones report as lacking what has not come yet
                if health.is_armable:
                    break
    except TimeoutError:
        pass
    finally:
        await values.aclose()
    if health is None:
        return None
    lacks = {
        "gyroscope not calibrated": health.is_gyrometer_calibration_ok,
        "accelerometer not calibrated": health.is_accelerometer_calibration_ok,
        "no local position": health.is_local_position_ok,
        "not armable": health.is_armable,
    }
    return tuple(lack for lack, well in lacks.items() if not well)
