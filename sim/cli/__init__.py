"""The command lines `gcs-sim` and `gcs-log`, around flights, studies and logs."""
