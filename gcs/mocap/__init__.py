"""Mocap sources: each turns one system's bytes into MocapFrame in lab axes."""
