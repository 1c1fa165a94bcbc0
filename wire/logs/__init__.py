"""MCAP logs, written and read."""
