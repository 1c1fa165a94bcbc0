"""Qualisys Track Manager's real-time protocol, read with `qtm-rt`'s packets."""
