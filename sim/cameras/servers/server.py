"""What every emulated camera system is: frames in, the vendor's protocol out, to any client."""

from typing import Protocol

from formation.messages import RawFrame


class Server(Protocol):
    """A vendor's server. It stamps frames by a clock of its own, and shows bodies out of sight as the vendor does."""

    async def start(self) -> None:
        """Listen; OSError where an address is taken."""

    def publish(self, frame: RawFrame) -> None:
        """Send one exposure, metres, to whoever is connected. Its bodies may change from frame to frame.

        t_capture_ns: the exposure on our monotonic clock; the server's own clock is that one, moved.
        """

    async def close(self) -> None:
        """End every connection and listen no more."""
