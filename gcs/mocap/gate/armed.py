"""Which drones have their motors on, by what the ground publishes of itself; that is all the mocap learns of it."""

import json


def armed_bodies(state: str) -> frozenset[str]:
    """The bodies of the drones that are armed in the ground's state (gcs.operator); none in what is no such state."""
    try:
        drones = json.loads(state)["drones"]
        return frozenset(str(drone["body"]) for drone in drones if drone["armed"] is True)
    except (ValueError, KeyError, TypeError):
        return frozenset()
