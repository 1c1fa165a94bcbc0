"""Qualisys Track Manager in a box: its real-time protocol over TCP and UDP."""

from sim.cameras.servers.qtm.server import QtmServer, qtm_server

__all__ = ["QtmServer", "qtm_server"]
