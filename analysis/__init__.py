"""What a flight log says: metrics, report, replay, check."""
