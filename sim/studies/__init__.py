"""Many flights, and what they show: paper, robustness, tune, league; and one flight again: what if."""
