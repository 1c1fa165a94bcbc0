"""The drone agent: a simulated quadcopter speaking MAVLink, or the bridge to a real autopilot."""
