"""What an autopilot does with its setpoints: modes, position control, landing, fail-safes."""
