"""The simulated autopilot's end of its MAVLink: what it reads, obeys, answers and sends."""
