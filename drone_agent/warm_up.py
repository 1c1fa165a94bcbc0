"""Compiles what every guard and simulated drone calls, before any motor turns: nothing compiles in flight."""

from drone_agent.bridge import estimate
from drone_agent.flight import position


def warm_up() -> None:
    """Both of its parts that call kernels at times of their own: the estimate of the body, and the way to a place."""
    position.warm_up()
    estimate.warm_up()
