"""Beside the rules: what the ground permits, drones that fly under no ground, how a landing ends, what is watched."""
