"""A NatNet server as Motive is one: 3.0 to 4.2, multicast or unicast."""

from sim.cameras.servers.natnet.responder import NatNetSettings
from sim.cameras.servers.natnet.server import NatNetServer, natnet_server

__all__ = ["NatNetServer", "NatNetSettings", "natnet_server"]
