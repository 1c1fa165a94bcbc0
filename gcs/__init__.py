"""The ground daemon."""

GCS_NAME = "main"
"""The ground of a lab that has one: its name on the bus."""
