"""Flight logs in notebooks and scripts: `gcs_log.load("flight.mcap")` gives every topic as columns of numpy arrays.

This is the one import for users; the rest of the packages may change.
"""

from analysis.tables.topic_tables import FlightLog, load
from wire.logs.mcap_log import LogError

__all__ = ["FlightLog", "LogError", "load"]
