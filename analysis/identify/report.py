"""What an identification says: a page of tables and pictures, lines for a terminal, JSON for scripts."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from rich.console import Console
from rich.table import Table
from rich.text import Text

from analysis import page
from analysis.identify.response import Response, first_order, step
from analysis.identify.sensing import Sensing
from analysis.identify.signals import Estimate
from analysis.identify.thrust import Thrust
from analysis.identify.vehicle import KNOWN_WITHIN, Identification, Identified
from analysis.load import Flight
from analysis.page import Folded, Section
from analysis.plots import style
from analysis.plots.style import Drawing, Missing
from formation.maths.arrays import Float
from formation.vehicle.body import GRAVITY_M_S2
from formation.vehicle.profile import VehicleProfile
from wire.config_file import dump_profile

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


LEAD = (
    "Left: measured tilt and the fitted attitude loop. Middle: that loop's step, and the dead time and lag nearest to "
    "it, which the controller uses. Right: specific force against sent thrust. Dashed: the profile flown "
    "with."
)


@dataclass(frozen=True, slots=True)
class Line:
    """One estimated quantity: its key (SI unit in it), the estimate or None, what the profile assumed.

    scale, unit: for people.
    """

    key: str
    name: str
    estimate: Estimate | None
    assumed: float | None
    scale: float = 1.0
    unit: str = ""

    def words(self) -> str:
        """`49.1 ms (48.7 to 49.6)`."""
        if self.estimate is None:
            return "no estimate from this flight"
        e = self.estimate.scaled(self.scale)
        unit = f" {self.unit}" if self.unit else ""
        return f"{e.value:.4g}{unit} ({e.low:.4g} to {e.high:.4g})"

    def assumed_words(self) -> str:
        """The profile's own value."""
        return "–" if self.assumed is None else f"{self.scale * self.assumed:.4g} {self.unit}".strip()


def drone_lines(drone: Identified) -> Iterator[Line]:
    """Everything estimated of one drone."""
    base = drone.base
    if isinstance(drone.response, Response):
        r = drone.response
        yield Line("response_dead_time_s", "attitude dead time", r.dead_time_s, base.response_dead_time_s, 1e3, "ms")
        yield Line("response_lag_s", "attitude lag", r.lag_s, base.response_lag_s, 1e3, "ms")
        yield Line("delay_s", "pure delay", r.delay_s, None, 1e3, "ms")
        yield Line("attitude_p_1_s", "attitude gain", r.attitude_p_1_s, base.attitude_p_1_s, 1.0, "1/s")
        yield Line("rate_p_1_s", "rate gain", r.rate_p_1_s, base.rate_p_1_s, 1.0, "1/s")
        yield Line("motor_lag_s", "motor lag", r.motor_lag_s, base.motor_lag_s, 1e3, "ms")
        yield Line("rate_lead", "takes body rates", r.rate_lead, float(base.rate_feed_forward))
    if isinstance(drone.thrust, Thrust):
        t = drone.thrust
        yield Line("hover_thrust_norm", "hover thrust", t.hover_norm, base.hover_thrust_norm)
        yield Line("thrust_curve", "thrust curve k", t.curve, base.thrust_curve)
        full = base.thrust_max_n / base.mass_kg
        yield Line("thrust_max_m_s2", "full thrust per mass", t.full_m_s2, full, 1.0, "m/s²")
        yield Line("thrust_fade_1_s", "thrust lost", t.fade_1_s, None, 6e3, "% a minute")
    if isinstance(drone.late_s, Estimate):
        yield Line("pose_late_s", "poses later than stamped", drone.late_s, None, 1e3, "ms")


def sensing_lines(sensing: Sensing) -> Iterator[Line]:
    """Everything estimated of the mocap."""
    yield Line("mocap_delay_s", "delay, capture to receipt", sensing.delay_s, None, 1e3, "ms")
    for noise in sensing.noise:
        yield Line(f"noise_{noise.body}_m", f"position noise, {noise.body}", noise.pos_m, None, 1e3, "mm")
        yield Line(f"noise_{noise.body}_rad", f"attitude noise, {noise.body}", noise.attitude_rad, None, 1e3, "mrad")


def print_identification(found: Identification, console: Console) -> None:
    """Every estimate beside what the profile assumes."""
    for drone in found.drones:
        title = Text(f"{drone.vehicle.body} (drone {drone.vehicle.sysid})")
        table = Table(title=title, title_justify="left", box=None)
        table.add_column(style="dim")
        table.add_column("estimate")
        table.add_column(Text(drone.base.name), style="dim")
        for line in drone_lines(drone):
            table.add_row(line.name, line.words(), line.assumed_words())
        for reason in (drone.response, drone.thrust):
            if isinstance(reason, str):
                table.add_row("untold", reason, "")
        console.print(table)
    if isinstance(found.sensing, str):
        console.print(f"mocap: {found.sensing}", highlight=False)
        return
    table = Table(title="motion capture", title_justify="left", box=None)
    table.add_column(style="dim")
    table.add_column("estimate")
    for line in sensing_lines(found.sensing):
        table.add_row(line.name, line.words())
    console.print(table)


def to_json(found: Identification) -> str:
    """Every estimate as {value, low, high}, by drone; null where there is none."""

    def entries(lines: Iterator[Line]) -> dict[str, dict[str, float] | None]:
        return {
            line.key: None
            if line.estimate is None
            else {"value": line.estimate.value, "low": line.estimate.low, "high": line.estimate.high}
            for line in lines
        }

    drones = {
        drone.vehicle.body: {
            "sysid": drone.vehicle.sysid,
            "base": drone.base.name,
            **entries(drone_lines(drone)),
            "untold": [reason for reason in (drone.response, drone.thrust, drone.late_s) if isinstance(reason, str)],
        }
        for drone in found.drones
    }
    mocap = entries(sensing_lines(found.sensing)) if isinstance(found.sensing, Sensing) else {"untold": None}
    return json.dumps({"drones": drones, "mocap": mocap}, indent=2, allow_nan=False)


def write(flight: Flight, found: Identification, path: Path) -> None:
    """Write the page."""
    leads = [LEAD] + [""] * len(found.drones)
    name = (flight.run.scenario or "flight").replace("_", " ")
    text = page.render(
        title=f"{name} · identification",
        kind="Vehicle identification",
        heading=name.capitalize(),
        facts="Estimated from one flight; in brackets the 95 % confidence interval.",
        sections=(
            *(_drone(flight, drone, lead) for drone, lead in zip(found.drones, leads, strict=False)),
            _mocap(found),
        ),
    )
    path.write_text(text, encoding="utf-8")


def _drone(flight: Flight, drone: Identified, lead: str) -> Section:
    """One drone: picture, table, profile to paste."""
    with style.styled():
        drawn = model_against_data(flight, drone)
    rows = [(line.name, line.words(), line.assumed_words()) for line in drone_lines(drone)]
    estimates = page.table(("quantity", "#estimate", f"#{drone.base.name}"), rows)
    profile = Folded("Profile to paste", text=dump_profile(drone.profile(KNOWN_WITHIN)))
    return Section(f"drone-{drone.vehicle.sysid}", drone.vehicle.body, lead, (drawn,), (estimates, profile))


def _mocap(found: Identification) -> Section:
    """The mocap's table."""
    if isinstance(found.sensing, str):
        return Section("mocap", "Motion capture", parts=(Missing(found.sensing),))
    rows = [(line.name, line.words()) for line in sensing_lines(found.sensing)]
    lead = (
        f"{found.sensing.rate_hz:.1f} frames a second; 99 % arrive within {1e3 * found.sensing.late_s:.1f} ms of their "
        "capture as the mocap stamps it. Attitude noise is taken from where a body stood still."
    )
    return Section("mocap", "Motion capture", lead, parts=(page.table(("quantity", "#estimate"), rows),))
