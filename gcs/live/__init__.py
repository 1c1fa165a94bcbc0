"""A flight live in viewers, by a process of its own that listens to the ground's log on the bus."""
