"""Mocap sources: each turns one system's bytes into MocapFrame, in that system's own axes and marker frames."""
