"""The command line: `python -m bench.security` takes every figure, one after the other."""

import json
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated

import typer
from rich.console import Console

from bench.security.datagram_flood import Arrivals, setpoints_beside
from bench.security.lab import keyed_lab
from bench.security.link_cost import Hop, Signing, bus_hop, signing_cost
from bench.security.stop_flood import Flood, Stops, stop_beside
from formation.config import LinkConfig
from sim.ports import own_ports

HOSTILE_HZ = 1e5


@dataclass(frozen=True, slots=True)
class Figures:
    """load: of this machine, processes that want a core, at the beginning; the figures are no better than that."""

    load: float
    cores: int
    signing: Signing
    hop_plain: Hop
    hop_with_keys: Hop
    setpoints_alone: Arrivals
    setpoints_beside_flood: Arrivals
    stops: Stops
    stops_from_elsewhere: Stops

    def to_json(self) -> str:
        """As one object."""
        return json.dumps(asdict(self), indent=2)


def measure(folder: Path, stops: int, setpoints: int, show: Callable[[str], None]) -> Figures:
    """Take every figure; `show` names it. The lab and its keys are made in the folder."""
    load = os.getloadavg()[0]
    with own_ports() as ports:
        lab = keyed_lab(folder, ports[1])
        links = LinkConfig(kind="udp", ground_port_base=ports[2] - 1, drone_port_base=ports[3] - 1)
        show("signing")
        signing = signing_cost()
        show("the bus without keys, and with")
        plain = bus_hop(lab, f"tcp/127.0.0.1:{ports[4]}", with_keys=False)
        with_keys = bus_hop(lab, f"tls/127.0.0.1:{ports[5]}", with_keys=True)
        show(f"{setpoints} setpoints alone, and beside {HOSTILE_HZ:.0f} hostile datagrams a second")
        alone = setpoints_beside(0.0, setpoints, lab, links)
        beside = setpoints_beside(HOSTILE_HZ, setpoints, lab, links)
        show(f"{stops} stops beside half-open connections, requests and a thief")
        stopped = stop_beside(Flood(), stops, lab)
        show("the same from another computer")
        stopped_from_elsewhere = stop_beside(Flood(), stops, lab, from_elsewhere=True)
    return Figures(load, os.cpu_count() or 1, signing, plain, with_keys, alone, beside, stopped, stopped_from_elsewhere)


def main(
    stops: Annotated[int, typer.Option(min=1, help="How many `gcs stop` beside the flood.")] = 30,
    setpoints: Annotated[int, typer.Option(min=1, help="How many signed setpoints, 100 a second.")] = 1000,
) -> None:
    """Measure what keys cost and what they withstand, by real sockets on loopback, as JSON. It judges nothing."""
    console = Console(stderr=True, markup=False)
    with TemporaryDirectory() as folder, console.status("starting") as status:
        print(measure(Path(folder), stops, setpoints, status.update).to_json())


if __name__ == "__main__":
    typer.run(main)
