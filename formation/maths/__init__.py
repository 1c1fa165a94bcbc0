"""Rotations, powers and arrays, and how kernels are compiled."""
