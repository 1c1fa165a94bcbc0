"""MAVProxy, from its own command line, against an agent over UDP."""

import contextlib
import os
import queue
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conformance.agent import Agent, agent

pytestmark = pytest.mark.processes
WAIT_S = 30.0


class Console:
    """MAVProxy's prompt: lines in, lines out."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self._process = process
        self._lines: queue.Queue[str] = queue.Queue()
        self.seen: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.put(line)

    def type(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()

    def expect(self, words: str, wait_s: float = WAIT_S) -> str:
        """The next line in which the pattern is found."""
        end = time.monotonic() + wait_s
        while (left_s := end - time.monotonic()) > 0.0:
            try:
                line = self._lines.get(timeout=left_s)
            except queue.Empty:
                break
            self.seen.append(line)
            if re.search(words, line):
                return line
        raise AssertionError(f"MAVProxy never said {words!r}:\n{''.join(self.seen[-60:])}")

    def repeat_until(self, line: str, words: str) -> str:
        """Type a line again and again until the words come."""
        for _ in range(round(WAIT_S / 2.0)):
            self.type(line)
            with contextlib.suppress(AssertionError):
                return self.expect(words, 2.0)
        raise AssertionError(f"{line!r} never brought {words!r}:\n{''.join(self.seen[-60:])}")


@contextlib.contextmanager
def mavproxy(running: Agent, folder: Path) -> Iterator[Console]:
    program = Path(sys.executable).with_name("mavproxy.py")
    command = [
        sys.executable, "-u", str(program), f"--master=udpin:127.0.0.1:{running.ground_port}",
        f"--target-system={running.sysid}",
        "--default-modules=mode,arm,param,cmdlong,link", "--state-basedir", str(folder), "--aircraft", "uav",
    ]  # fmt: skip
    surroundings = {**os.environ, "HOME": str(folder), "MPLBACKEND": "Agg"}
    process = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=folder,
        env=surroundings,
    )  # fmt: skip
    try:
        yield Console(process)
    finally:
        process.terminate()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait(10.0)
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()


def test_ardupilot_from_the_prompt(tmp_path: Path) -> None:
    keys = "profile = 'px4_quad'\nautopilot = 'ardupilot'"
    with agent(tmp_path, keys) as running, mavproxy(running, tmp_path) as console:
        console.expect("Detected vehicle 1:1")
        console.expect("Received")
        console.repeat_until("param show GUID_TIMEOUT", "GUID_TIMEOUT     3.0")
        console.type("param set GUID_TIMEOUT 2.5")
        console.repeat_until("param show GUID_TIMEOUT", "GUID_TIMEOUT     2.5")
        console.type("mode GUIDED")
        console.expect("Mode GUIDED")
        console.repeat_until("arm throttle", "ARMED")
        console.type("takeoff 1.5")
        console.expect("NAV_TAKEOFF: ACCEPTED")
        console.repeat_until("status GLOBAL_POSITION_INT", r"relative_alt : 1[45]\d\d")
        console.type("mode LAND")
        console.expect("DISARMED")
        assert not [line for line in console.seen if "breach" in line]
