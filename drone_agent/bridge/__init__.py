"""The bridge to a real autopilot."""
