"""The quadcopter as the controller knows it: its profile, its body, how it answers a command."""
