"""What the commands of `gcs` do in a terminal."""
