"""Fading-memory polynomial filters (Morrison 1969, chapter 13), in place; a sample's weight falls as exp(-pole t)."""


def first_degree(line: list[float], measured: float, bend: float, decay: float, dt_s: float) -> float:
    """Place and rate after one more sample; kept: a sample's weight after dt_s. Returns by how much it was missed.

    bend: known otherwise. Of the variance of white noise in `measured` the rate has
    2 (1 - kept)^3 / (1 + kept)^3 / dt_s^2.
    """
    line[0] += dt_s * (line[1] + 0.5 * dt_s * bend)
    line[1] += dt_s * bend
    innovation = measured - line[0]
    line[0] += (1.0 - decay * decay) * innovation
    line[1] += (1.0 - decay) ** 2 / dt_s * innovation
    return innovation


def second_degree(curve: list[float], measured: float | None, decay: float, dt_s: float) -> float:
    """The same with acceleration; only carried on where nothing was measured."""
    curve[0] += dt_s * (curve[1] + 0.5 * dt_s * curve[2])
    curve[1] += dt_s * curve[2]
    if measured is None:
        return 0.0
    innovation = measured - curve[0]
    curve[0] += (1.0 - decay**3) * innovation
    curve[1] += 1.5 * (1.0 - decay) ** 2 * (1.0 + decay) / dt_s * innovation
    curve[2] += (1.0 - decay) ** 3 / dt_s**2 * innovation
    return innovation
