"""Which drones have their motors on, from the ground's published state; the mocap reads nothing else of it."""

from collections.abc import Mapping

from wire.text import parse_object


def motors_on(state: str) -> Mapping[str, bool]:
    """Whether each drone is armed, by body, in the ground's state (gcs.state.swarm); nobody's in what is no such state.

    A ground that has only just begun does not know it of a drone that it has not heard of yet.
    """
    try:
        drones = parse_object(state)["drones"]
        known = [drone for drone in drones if drone["heartbeat_age_s"] is not None]
        return {str(drone["body"]): drone["armed"] is True for drone in known}
    except (ValueError, LookupError, TypeError):
        return {}
