"""Logs that others recorded, brought in: a reader a format, one map to our quantities, one writer."""
