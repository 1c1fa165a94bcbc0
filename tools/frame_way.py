"""The way of one mocap frame to a datagram: which files of ours it runs through, in which order, and how often back.

    python -m tools.frame_way          # a minute: the kernels run as plain Python
    python -m tools.frame_way --json

A flight of `triangle_line` is flown into the formation. Then one frame is traced: from the source's RawFrame in the
mocap core, over the bus's bytes, to the bytes of SET_ATTITUDE_TARGET. The camera system's own decoder comes before it.
A *return* is a file that is entered for the first time in a folder that the way has left before. The folders of TOOLS
are called from everywhere, so they count as files, not as returns.
"""

import argparse
import json
import os
import sys
from pathlib import Path
from types import FrameType

os.environ["NUMBA_DISABLE_JIT"] = "1"

from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar
from unittest.mock import patch

from formation.messages import LabFrame, Phase, RawFrame
from gcs.core import GcsCore, Outgoing
from mocap.core import MocapCore
from sim.scenario import load
from sim.world import World
from wire.schema import schema_of
from wire.transport.frame_check import lab_fault

ROOT = Path(__file__).resolve().parents[1]
OURS = ("formation", "wire", "mocap", "gcs")
TOOLS = ("formation/maths", "formation", "wire", "wire/process")
P = ParamSpec("P")
R = TypeVar("R")
AFTER_NS = 2_000_000_000
"""In formation, before the frame that is traced."""


class Trace:
    """The files that calls enter, in their order."""

    def __init__(self) -> None:
        self.files: list[str] = []

    def enter(self, frame: FrameType, event: str, arg: object) -> None:
        """A profile function: a call into one of our files is appended, unless the last one was into the same."""
        file = frame.f_code.co_filename
        if event == "call" and file.startswith(str(ROOT)):
            place = file[len(str(ROOT)) + 1 :]
            if place.split("/")[0] in OURS and (not self.files or self.files[-1] != place):
                self.files.append(place)

    def returns(self) -> int:
        """How often the way, by first calls, enters a folder again that it has left."""
        folders = [folder for file in dict.fromkeys(self.files) if (folder := file.rpartition("/")[0]) not in TOOLS]
        way = [folder for at, folder in enumerate(folders) if at == 0 or folders[at - 1] != folder]
        return len(way) - len(set(way))

    def of(self, step: Callable[P, R]) -> Callable[P, R]:
        """The step, traced."""

        def run(*arguments: P.args, **named: P.kwargs) -> R:
            sys.setprofile(self.enter)
            try:
                return step(*arguments, **named)
            finally:
                sys.setprofile(None)

        return run


def traced() -> Trace:
    """Fly into the formation, and trace the next frame: each that the mocap receives starts the trace again."""
    trace, world = Trace(), World(load("triangle_line"), 1, lambda _topic, _message, _t_ns: None)
    since_ns = None
    while since_ns is None or world.now_ns < since_ns + AFTER_NS:
        world.step()
        if world.phase is Phase.FORMATION and since_ns is None:
            since_ns = world.now_ns
    see, receive, tick, schema = MocapCore.receive, GcsCore.receive, GcsCore.tick, schema_of(LabFrame)

    def from_the_cameras(core: MocapCore, raw: RawFrame | LabFrame, now_ns: int) -> LabFrame | None:
        trace.files.clear()
        return trace.of(see)(core, raw, now_ns)

    def over_the_bus(core: GcsCore, message: Any, now_ns: int) -> None:
        if isinstance(message, LabFrame):
            message = trace.of(lambda: schema.decode(schema.encode(message)))()
            trace.of(lab_fault)(message, now_ns)
            trace.of(receive)(core, message, now_ns)
        else:
            receive(core, message, now_ns)

    def to_the_drones(core: GcsCore, now_ns: int) -> Outgoing:
        return trace.of(tick)(core, now_ns) if trace.files else tick(core, now_ns)

    with (
        patch.object(MocapCore, "receive", from_the_cameras),
        patch.object(GcsCore, "receive", over_the_bus),
        patch.object(GcsCore, "tick", to_the_drones),
    ):
        while "wire/mavlink/codec.py" not in trace.files:
            world.step()
    return trace


def main() -> None:
    """Print the way, in its order, and the counts."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--json", action="store_true")
    trace = traced()
    counts = {"files": len(set(trace.files)), "returns": trace.returns()}
    if parser.parse_args().json:
        print(json.dumps(counts | {"way": trace.files}))
        return
    for file in dict.fromkeys(trace.files):
        print(file)
    print(f"{counts['files']} files, {counts['returns']} returns")


if __name__ == "__main__":
    main()
