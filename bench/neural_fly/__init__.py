"""Neural-Fly's recorded figure-8 in wind, flown by the whole stack; the recordings are the user's to fetch."""
