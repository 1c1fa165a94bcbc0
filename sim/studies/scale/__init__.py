"""What grows with the number of drones, or with the length of a flight."""
