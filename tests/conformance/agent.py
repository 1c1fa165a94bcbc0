"""Starts a drone agent as its own process on ports of its own, and ends it as an operator would."""

import contextlib
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from tests.free_ports import free_port

START_S = 30.0  # an agent's first start on a loaded machine, numba's cache included


@dataclass(frozen=True)
class Agent:
    """A running agent: its number and the UDP ports of both ends."""

    sysid: int
    ground_port: int
    drone_port: int
    process: subprocess.Popen[bytes]

    @property
    def mavsdk_url(self) -> str:
        return f"udpin://127.0.0.1:{self.ground_port}"


@contextlib.contextmanager
def agent(folder: Path, keys: str = "", sysid: int = 1) -> Iterator[Agent]:
    """An agent by UDP with these keys in its file, that ends with the block, cleanly."""
    ground_port, drone_port = free_port(), free_port()
    config = folder / f"uav{sysid}.toml"
    ports = f"ground_port_base = {ground_port - sysid}\ndrone_port_base = {drone_port - sysid}"
    config.write_text(f"{keys}\n[link]\nkind = 'udp'\n{ports}\n")
    command = [sys.executable, "-m", "drone_agent", "--sysid", str(sysid), "--config", str(config)]
    with (folder / f"uav{sysid}.log").open("wb") as log:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)
        try:
            yield Agent(sysid, ground_port, drone_port, process)
            assert process.poll() is None, (folder / f"uav{sysid}.log").read_text()
        finally:
            process.send_signal(signal.SIGINT)
            code = process.wait(10.0)
    assert code == 0, (folder / f"uav{sysid}.log").read_text()
