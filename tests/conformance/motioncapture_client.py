"""The `motioncapture` wheel (libmotioncapture) as a client: reads so many frames, and prints what it read as JSON.

    python motioncapture_client.py vicon 127.0.0.1:801 100
    python motioncapture_client.py qualisys 127.0.0.1 22222 100

Its own process, since it waits for ever for a server that has gone.
"""

import json
import sys

import motioncapture  # of another environment


def main() -> None:
    """Every pose of every frame."""
    kind, host, *port, count = sys.argv[1:]
    further = {"port": port[0]} if port else {"interface_ip": host} if kind == "optitrack" else {}
    system = motioncapture.connect(kind, {"hostname": host, **further})
    frames = []
    for _ in range(int(count)):
        system.waitForNextFrame()
        frames.append({name: _pose(body) for name, body in system.rigidBodies.items()})
    print("FRAMES", json.dumps(frames), flush=True)


def _pose(body: object) -> list[float]:
    r = body.rotation
    return [*map(float, body.position), r.w, r.x, r.y, r.z]


if __name__ == "__main__":
    main()
