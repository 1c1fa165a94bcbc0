"""What this process reports to its service manager: systemd's sd_notify, datagrams to the socket that it names.

Without such a manager nothing is sent. One that does not take a datagram at once goes without: it stops no flight.
"""

import os
import socket
from contextlib import suppress

READY = "READY=1"
"""`systemctl start` returns, and what is ordered after this is started."""
FEED_NS = 200_000_000


def notify(state: str) -> None:
    """Send one state, as systemd's sd_notify(3) has them: READY, "STATUS=text"."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if address:
        name = f"\0{address[1:]}" if address.startswith("@") else address
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.sendto(state.encode(), socket.MSG_DONTWAIT, name)


class Watchdog:
    """Says every FEED_NS that the process goes on; where it does not, its manager ends it after `WatchdogSec`."""

    def __init__(self) -> None:
        self._due_ns = 0

    def feed(self, now_ns: int) -> None:
        """Call it where the process does its work."""
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + FEED_NS
            notify("WATCHDOG=1")
