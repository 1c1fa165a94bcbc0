"""The emulated motion capture."""
