"""What no user runs on a lab of their own: benchmarks, attacks, long flights, flights against others' recordings."""
