"""What an identification says: lines for a terminal, JSON for scripts."""

import json
from collections.abc import Iterator
from dataclasses import dataclass

from rich.console import Console
from rich.table import Table
from rich.text import Text

from analysis.identify.drag import Drag
from analysis.identify.response import Response
from analysis.identify.sensing import Sensing
from analysis.identify.signals import Estimate
from analysis.identify.thrust import Thrust
from analysis.identify.vehicle import Identification, Identified


@dataclass(frozen=True, slots=True)
class Line:
    """One estimated quantity: its key (SI unit in it), the estimate or None, what the profile assumed.

    scale, unit: for people; by: what in the log says it.
    """

    key: str
    name: str
    estimate: Estimate | None
    assumed: float | None
    scale: float = 1.0
    unit: str = ""
    by: str = ""

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
        r, by = drone.response, "attitudes: commanded, cameras"
        yield Line(
            "response_dead_time_s", "attitude dead time", r.dead_time_s, base.response_dead_time_s, 1e3, "ms", by
        )
        yield Line("response_lag_s", "attitude lag", r.lag_s, base.response_lag_s, 1e3, "ms", by)
        yield Line("delay_s", "pure delay", r.delay_s, None, 1e3, "ms", by)
        yield Line("attitude_p_1_s", "attitude gain", r.attitude_p_1_s, base.attitude_p_1_s, 1.0, "1/s", by)
        yield Line("rate_p_1_s", "rate gain", r.rate_p_1_s, base.rate_p_1_s, 1.0, "1/s", by)
        yield Line("motor_lag_s", "motor lag", r.motor_lag_s, base.motor_lag_s, 1e3, "ms", by)
        yield Line("tilt_share", "tilt, of that commanded", r.tilt_share, 1.0, by=by)
        yield Line("rate_lead", "takes body rates", r.rate_lead, float(base.rate_feed_forward), by=by)
    if isinstance(drone.thrust, Thrust):
        t, by = drone.thrust, "thrust commanded, height"
        yield Line("hover_thrust_norm", "hover thrust", t.hover_norm, base.hover_thrust_norm, by=by)
        yield Line("thrust_curve", "thrust curve k", t.curve, base.thrust_curve, by=by)
        full = base.thrust_max_n / base.mass_kg
        yield Line("thrust_max_m_s2", "full thrust per mass", t.full_m_s2, full, 1.0, "m/s²", by)
        yield Line("thrust_fade_1_s", "thrust lost", t.fade_1_s, None, 6e3, "% a minute", by)
    if isinstance(drone.drag, Drag):
        d, by, mean = drone.drag, "poses: tilt, motion", float(base.drag_1_s[0])
        yield Line("drag_1_s", "drag over mass", d.drag_1_s, mean, 1.0, "1/s", by)
        yield Line("trim_x_rad", "markers tilt forward", d.trim_x, None, 1e3, "mrad", by)
        yield Line("trim_y_rad", "markers tilt left", d.trim_y, None, 1e3, "mrad", by)
    if isinstance(drone.late_s, Estimate):
        by = "attitudes: its own, cameras"
        yield Line("pose_late_s", "poses later than stamped", drone.late_s, None, 1e3, "ms", by)


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
        table.add_column("known by", style="dim")
        for line in drone_lines(drone):
            table.add_row(line.name, line.words(), line.assumed_words(), line.by)
        for reason in sorted(drone.untold):
            table.add_row("not known", reason, "")
        console.print(table)
        console.print(f"as in {drone.base.name}: {', '.join(drone.unchanged())}", highlight=False)
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
            "untold": sorted(drone.untold),
            "unchanged": drone.unchanged(),
        }
        for drone in found.drones
    }
    mocap = entries(sensing_lines(found.sensing)) if isinstance(found.sensing, Sensing) else {"untold": None}
    return json.dumps({"drones": drones, "mocap": mocap}, indent=2, allow_nan=False)
