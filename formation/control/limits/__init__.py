"""What no demand may lead to, whatever the law asks: too fast, too near to another, out of the fence."""

MONITORS = SEPARATION_FILTER, SPEED_LIMIT, KEEP_OUT = ("separation-filter", "speed-limit", "keep-out")
"""What alters demands, by the names under which a campaign switches it off."""
