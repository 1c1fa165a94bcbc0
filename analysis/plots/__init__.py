"""Pictures of a flight: each function draws one figure from a flight, or says what the log lacks for it."""
