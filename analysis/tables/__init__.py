"""A log as plain columns, for notebooks and other programs."""
