"""What a flight log says: metrics, report, replay, check."""

import os

# Before matplotlib is imported: a notebook's MPLBACKEND names a backend of its own installation.
os.environ["MPLBACKEND"] = "agg"
