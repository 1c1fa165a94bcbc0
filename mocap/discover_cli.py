"""What `gcs mocap discover` prints."""

import asyncio
import json
import sys
from dataclasses import asdict

from rich.console import Console
from rich.table import Table
from rich.text import Text

from mocap.discover import discover as find


def discover(hosts: tuple[str, ...], wait_s: float, as_json: bool) -> None:
    """Ask, wait, and print the servers that answered; none is no error."""
    print(f"gcs: asking the network, and {len(hosts)} hosts, for {wait_s:g} s", file=sys.stderr)
    found = asyncio.run(find(hosts, wait_s))
    if as_json:
        print(json.dumps([asdict(finding) for finding in found]))
        return
    if not found:
        print("no camera system answered: name its computer as well, `gcs mocap discover HOST`")
        return
    table = Table(box=None, pad_edge=False)
    for column in ("source", "address", "name", "version"):
        table.add_column(column, no_wrap=True)
    for finding in found:
        table.add_row(*map(Text, (finding.protocol, finding.address, finding.name, finding.version)))
    Console().print(table)
