"""Short flights for real processes, and how to start and watch `gcs-sim fly` from outside."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

TRIANGLE = """
name = "short_triangle"
script = [
    {{ verb = "arm", phase = "GROUND" }},
    {{ verb = "takeoff", phase = "ARMED" }},
    {{ verb = "start", phase = "HOLD", after_s = 0.2 }},
    {{ verb = "hold", phase = "FORMATION", leader_done = true, after_s = 0.2 }},
    {{ verb = "land", phase = "HOLD", after_s = 0.2 }},
]

[mocap]
rate_hz = {rate_hz}
gaps = {gaps}

[lab]
name = "lab"

[lab.mocap]
rate_hz = {rate_hz}
{cameras}
[lab.leader]
body = "leader"
sysid = 1
q_marker_from_flu = {q_marker_from_flu}
trajectory = {{ {trajectory} }}

[[lab.followers]]
body = "right"
sysid = 2
offset_m = [-0.4, -0.4, 0.0]

[[lab.followers]]
body = "left"
sysid = 3
offset_m = [-0.4, 0.4, 0.0]
"""
SPEED, RATE_HZ = 0.35, 50.0
"""Of every flight by real processes: a machine that is merely slow, or has others to serve, must not fail it."""
LINE = 'kind = "line", length_m = 0.5, duration_s = 2.0'
CIRCLE = 'kind = "circle", radius_m = 0.5, period_s = 5.0, duration_s = 60.0'


PLAIN, UPSIDE_DOWN = "[1.0, 0.0, 0.0, 0.0]", "[0.0, 0.6, 0.8, 0.0]"


def write_scenario(
    folder: Path, trajectory: str, cameras: str = "", q_marker_from_flu: str = PLAIN, gaps: str = "[]"
) -> Path:
    """cameras: further lines of the lab's [mocap]; q_marker_from_flu: of the leader; gaps: of the emulated mocap."""
    path = folder / "short_triangle.toml"
    text = TRIANGLE.format(
        trajectory=trajectory, rate_hz=RATE_HZ, cameras=cameras, q_marker_from_flu=q_marker_from_flu, gaps=gaps
    )
    path.write_text(text)
    return path


@contextmanager
def gcs_sim_fly(*arguments: str, hosts: int | None = 1) -> Iterator[subprocess.Popen[str]]:
    """`gcs-sim fly` running, its drones by so many processes, None: one each; its output is text on `stdout`.

    Interrupted, and waited for, on leaving.
    """
    shared = () if hosts is None else ("--hosts", str(hosts))
    with subprocess.Popen(
        [sys.executable, "-m", "sim", "fly", "--speed", str(SPEED), *shared, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=os.environ | {"COLUMNS": "300"},
    ) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
                process.communicate()


def read_until(process: subprocess.Popen[str], word: str) -> str:
    """Everything printed up to and with the line that holds `word`; fails if the process ends before."""
    assert process.stdout is not None
    said = ""
    for line in process.stdout:
        said += line
        if word in line:
            return said
    raise AssertionError(f"ended without {word!r}:\n{said}")


def processes_of(folder: Path) -> dict[int, list[str]]:
    """The command lines, by process id, of all processes that were told of `folder`."""
    found = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit() or int(entry.name) == os.getpid():
            continue
        try:
            words = (entry / "cmdline").read_bytes().decode().split("\0")
        except OSError:  # it has ended meanwhile
            continue
        if any(str(folder) in word for word in words):
            found[int(entry.name)] = words
    return found


def pid_of(folder: Path, tells: Callable[[list[str]], bool]) -> int:
    """The one process of the flight whose command line `tells`."""
    (pid,) = (pid for pid, words in processes_of(folder).items() if tells(words))
    return pid
