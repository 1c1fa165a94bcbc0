"""The properties of each autopilot, one table a file, for the ground and for the simulated drone alike."""
