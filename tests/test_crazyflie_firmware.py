"""The commands of the manual's page on Crazyflies, against the firmware in the loop, where `cf2` is on the PATH."""

import re
import shlex
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Generator, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from tests.free_ports import free_port
from wire import crtp

FIRMWARE = shutil.which("cf2")
PAGE = Path("docs/manual/howto/crazyflie.md").read_text(encoding="utf-8")
COMMANDS = [line for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL) for line in block.splitlines()]
RADIO = "radio://0/80/2M/E7E7E7E701"

pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(FIRMWARE is None, reason="cf2, the firmware in the loop, is not on the PATH"),
    pytest.mark.timeout(240),
]


def test_the_page_has_these_commands() -> None:
    assert [shlex.split(command)[:2] for command in COMMANDS] == [["drone-agent", "--lab"], ["gcs", "doctor"]]


def test_the_bridge_connects_and_doctor_mends_its_parameters(tmp_path: Path) -> None:
    firmware, client, control, bus = (free_port() for _ in range(4))
    (tmp_path / "lab.toml").write_text(
        f"""[leader]
body = "left"
sysid = 1
profile = "crazyflie_27g"
[[followers]]
body = "right"
sysid = 2
profile = "crazyflie_27g"
offset_m = [-1.0, 0.0, 0.0]
[link]
zenoh_listen = ["tcp/127.0.0.1:{bus}"]
zenoh_connect = []
"""
    )
    world = ["-m", "bench.crazyflie", "--firmware", str(firmware), "--client", str(client), "--control", str(control)]
    bridge, doctor = (shlex.split(command.replace(RADIO, f"udp://127.0.0.1:{client}")) for command in COMMANDS)
    with ExitStack() as processes:
        processes.enter_context(running([sys.executable, *world], Path.cwd()))
        processes.enter_context(running([str(FIRMWARE), str(firmware), "127.0.0.1"], tmp_path))
        written(client, "locSrv.extPosStdDev", 0.25)
        processes.enter_context(running(tool(bridge), tmp_path))
        result = subprocess.run(
            [*tool(doctor), "--still", "--yes", "--json"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
    assert "left: CF_POS_STD written" in result.stdout + result.stderr


def tool(words: list[str]) -> list[str]:
    return [str(Path(sys.executable).with_name(words[0])), *words[1:]]


@contextmanager
def running(command: list[str], folder: Path) -> Iterator[None]:
    process = subprocess.Popen(command, cwd=folder)
    try:
        yield
    finally:
        process.kill()
        process.wait()


def written(port: int, name: str, value: float) -> None:
    """Write a parameter of the firmware, as another client may have done."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.settimeout(0.5)
        link.connect(("127.0.0.1", port))
        connection = answered(link, crtp.connect())
        request = crtp.write_parameter(connection.parameters[name], value)
        assert request is not None
        answered(link, (each for each in (request,)))


def answered(link: socket.socket, dialogue: "crtp.Dialogue | Generator[crtp.Request, bytes, None]") -> crtp.Connection:
    request = next(dialogue)
    for _ in range(5_000):
        try:
            link.send(request.packet)
            data = link.recv(64)
            while not request.is_answered_by(data):
                data = link.recv(64)
            request = dialogue.send(data)
        except OSError:
            time.sleep(0.02)  # not started yet, or lost
        except StopIteration as end:
            return end.value  # type: ignore[no-any-return]
    raise AssertionError("the firmware does not answer")
