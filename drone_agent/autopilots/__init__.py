"""The makes of autopilot an agent can be, as tables."""
