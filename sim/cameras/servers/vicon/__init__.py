"""A Vicon DataStream server in a box, as Tracker's."""

from sim.cameras.servers.vicon.server import ViconServer, vicon_server

__all__ = ["ViconServer", "vicon_server"]
