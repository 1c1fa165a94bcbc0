"""A VRPN server in a box, and Chingmu's manner of one."""

from sim.cameras.servers.vrpn.server import VrpnServer, chingmu_server, vrpn_server

__all__ = ["VrpnServer", "chingmu_server", "vrpn_server"]
