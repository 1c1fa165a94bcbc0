"""What the ground publishes of itself ten times a second: for `gcs status`, the page, `gcs watch` and scripts."""
