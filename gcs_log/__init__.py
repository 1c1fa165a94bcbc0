"""Flight logs in notebooks and scripts: `gcs_log.load("flight.mcap")` gives every topic as columns of numpy arrays.

This is the one import for users; the rest of the packages may change. It imports none of them: a folder of yours may
have modules named `analysis` or `wire`, and those stay yours.
"""

from gcs_log.flight_log import FlightLog, LogError, load

__all__ = ["FlightLog", "LogError", "load"]
