"""Model against data of an identified vehicle: tilt, step response, thrust."""

import numpy as np
from matplotlib.axes import Axes

from analysis.identify.response import Response, first_order, step
from analysis.identify.thrust import Thrust
from analysis.identify.vehicle import Identified
from analysis.load import Flight
from analysis.plots import style
from analysis.plots.style import Drawing, Missing
from formation.maths.arrays import Float
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile

CLOSE_UP_S = 3.0
DATA = "#8fa3b8"


def model_against_data(flight: Flight, drone: Identified) -> Drawing:
    """Measured tilt and the model's; the step response and the controller's; specific force against thrust."""
    if isinstance(drone.response, str) and isinstance(drone.thrust, str):
        return Missing(f"{drone.vehicle.body}: {drone.response}; {drone.thrust}")
    fig, [[tilt, steps, force]] = style.Sheet(3.0, widths=(1.25, 1.0, 1.0), share_x="none").axes()
    colour = style.colours(len(flight.vehicles))[flight.vehicles.index(drone.vehicle)]
    if isinstance(drone.response, Response):
        _tilt(tilt, drone.response, colour)
        _steps(steps, drone.response, drone.base, colour)
    else:
        _show_reason(tilt, drone.response)
        _show_reason(steps, drone.response)
    if isinstance(drone.thrust, Thrust):
        _force(force, drone.thrust, drone.base, colour)
    else:
        _show_reason(force, drone.thrust)
    return fig


def _show_reason(ax: Axes, reason: str) -> None:
    """An empty panel with its reason."""
    ax.axis("off")
    ax.text(0.5, 0.5, reason, ha="center", va="center", color=style.SOFT, wrap=True, transform=ax.transAxes)


def _tilt(ax: Axes, found: Response, colour: str) -> None:
    """The liveliest seconds: the axis and place where the model moves most."""
    starts = np.arange(found.t_s[0], max(found.t_s[-1] - CLOSE_UP_S, found.t_s[0] + 1e-6), CLOSE_UP_S / 2.0)
    windows = [(found.t_s >= start) & (found.t_s <= start + CLOSE_UP_S) for start in starts]
    lively = np.array([found.modelled[w].std(axis=0) if w.any() else np.zeros(2) for w in windows])
    at, axis = np.unravel_index(int(np.argmax(lively)), lively.shape)
    shown = windows[int(at)]
    measured, modelled = (np.degrees(v[shown, axis]) for v in (found.measured, found.modelled))
    ax.plot(found.t_s[shown], measured, ".", ms=3.5, color=DATA, mew=0, label="measured")
    ax.plot(found.t_s[shown], modelled, color=colour, lw=1.3, label="model")
    ax.set(title="Tilt", xlabel="time, s", ylabel="tilt, °")
    style.legend(ax)


def _steps(ax: Axes, found: Response, base: VehicleProfile, colour: str) -> None:
    """The fitted loop's step, the dead time and lag nearest to it, and those of the profile flown with."""
    t_s = np.linspace(0.0, found.dead_time_s.value + 5.0 * found.lag_s.value, 300)
    ax.plot(1e3 * t_s, step(found.parameters, t_s), color=DATA, lw=3.0, label="fitted loop")
    nearest = first_order(t_s, found.dead_time_s.value, found.lag_s.value)
    ax.plot(1e3 * t_s, nearest, color=colour, lw=1.3, label="dead time + lag")
    assumed = first_order(t_s, base.response_dead_time_s, base.response_lag_s)
    ax.plot(1e3 * t_s, assumed, color=style.INK, lw=0.9, ls=(0, (4, 3)), label=base.name)
    ax.set(title="Attitude step", xlabel="after the target, ms", ylabel="of the step")
    ax.legend(loc="lower right")


def _force(ax: Axes, found: Thrust, base: VehicleProfile, colour: str) -> None:
    """Specific force against thrust sent; the fitted curve and the profile's through the same hover."""
    low, high = float(found.sent_norm.min()), float(found.sent_norm.max())
    u = np.linspace(low - 0.3 * (high - low), high + 0.3 * (high - low), 60)
    ax.plot(found.sent_norm, found.force_m_s2, ".", ms=3.0, color=DATA, mew=0, label="windows")
    curve = base.thrust_curve if found.curve is None else found.curve.value
    ax.plot(u, _curve(u, curve, found.hover_norm.value), color=colour, lw=1.3, label="model")
    ax.plot(
        u,
        _curve(u, base.thrust_curve, base.hover_thrust_norm),
        color=style.INK,
        lw=0.9,
        ls=(0, (4, 3)),
        label=base.name,
    )
    ax.axhline(GRAVITY_M_S2, color=style.FAINT, lw=0.8, zorder=1)
    ax.set(title="Thrust", xlabel="sent, 0..1", ylabel="specific force, m/s²")
    ax.legend(loc="upper left")


def _curve(u: Float, k: float, hover: float) -> Float:
    """Specific force of a thrust curve that hovers at `hover`."""
    force: Float = GRAVITY_M_S2 * ((1.0 - k) * u + k * u * u) / ((1.0 - k) * hover + k * hover * hover)
    return force
