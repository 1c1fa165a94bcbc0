"""Prints as JSON the files that one frame and one stop pass on their way; run by `bench.size` in a tree's own folder.

One frame: a leader and two followers in lockstep, from a raw frame's arrival to the commands that the guards hand to
their autopilots: the files that most of fifty frames pass, and how often the folder changes from call to call until
the ground has sent. One stop: the datagram that `gcs stop` sends, read by the ground's port, and obeyed.
Kernels are compiled: what they call in turn is not counted. Simulated cameras, links, vehicles and autopilots are left
out, but for the calls of our own functions in a second of that flight.
"""

import json
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from statistics import median
from types import FrameType

from formation.requests import OperatorRequest, Verb
from sim.lockstep import warm_up
from sim.scenario import load
from sim.world import T0_NS, World
from wire.transport.stop_call import StopReader, StopRequest, encode_stop

ROOT = f"{Path.cwd()}/"
OURS = ("formation/", "wire/", "mocap/", "gcs/", "drone_agent/", "sim/")
SIMULATED = (
    "drone_agent/simulation", "drone_agent/flight", "drone_agent/autopilots", "drone_agent/link", "drone_agent/core.py",
    "drone_agent/guarded.py", "sim/",
)  # fmt: skip
BEGIN_NS, SECOND_NS, FRAMES = T0_NS + 20_000_000_000, 1_000_000_000, 50
KEY, DRAWN = b"lab", bytes(range(16))


@contextmanager
def traced() -> Iterator[list[str]]:
    """The files of the calls made while it is entered, in their order."""
    files: list[str] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        file = frame.f_code.co_filename.removeprefix(ROOT)
        if event == "call" and file.startswith(OURS):
            files.append(file)

    sys.setprofile(note)
    try:
        yield files
    finally:
        sys.setprofile(None)


def flown(files: list[str]) -> list[str]:
    """Without those that only simulate."""
    return [file for file in files if not file.startswith(SIMULATED)]


def main() -> None:
    """Fly to where the way is taken."""
    scenario = load("triangle_circle")
    warm_up(scenario)
    world = World(scenario, scenario.seed, lambda *_: None)
    while world.now_ns < BEGIN_NS:
        world.step()
    frames, changes = Counter[str](), []
    for _ in range(FRAMES):
        while world._emulator.cable.next_due_ns > world._next_event_ns():
            world.step()
        with traced() as arrived:
            world.step()
        with traced() as followed:
            while world._next_event_ns() < world._emulator.next_exposure_ns:
                world.step()
        folders = [file.rpartition("/")[0] for file in flown(arrived)]
        changes.append(sum(a != b for a, b in pairwise(folders)))
        frames.update({*flown(arrived), *flown(followed)})
    with traced() as second:
        end_ns = world.now_ns + SECOND_NS
        while world.now_ns < end_ns:
            world.step()
    with traced() as stop:
        _stop(world)
    usual = sorted(file for file, times in frames.items() if 2 * times > FRAMES)
    told = {"frame": usual, "frame_folder_changes": int(median(changes)), "stop": sorted(set(flown(stop)))}
    print(json.dumps(told | {"python_calls": len(second)}))


def _stop(world: World) -> None:
    ground, reader = world._grounds[0], StopReader({"": KEY}.get, lambda _: DRAWN)
    found: object = b""
    for challenge in (bytes(16), DRAWN):  # who asks learns the challenge by asking
        found = reader.read(encode_stop("", KEY, 1, "bench", challenge))
    assert isinstance(found, StopRequest)
    ground.receive(OperatorRequest(found.id, Verb.STOP, source=found.source), world.now_ns)
    datagrams, _ = ground.tick(world.now_ns)
    for datagram in datagrams:
        node = world.nodes[datagram.sysid]
        node.drone.receive(datagram, world.now_ns)
        node.drone.tick(world.now_ns)
    assert not any(sample.armed for sample in world.samples()), "the motors run on"


if __name__ == "__main__":
    main()
