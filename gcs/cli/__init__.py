"""The commands of `gcs` in a terminal."""
