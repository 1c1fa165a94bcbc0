"""Many flights, and what they show: paper, tune, league; and one flight again: what if."""
