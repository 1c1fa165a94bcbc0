"""Each drone as the ground knows it: its link, its autopilot, its parameters, its commands."""
