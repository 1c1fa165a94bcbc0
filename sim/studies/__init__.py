"""Many lockstep flights, and what they show: paper, robustness, tune."""
