"""Bytes, sockets, clocks and files: the edges of the system."""
