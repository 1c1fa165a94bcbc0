"""A lab's own control law for the followers in formation: `law` says what it is, `flight` flies it."""
